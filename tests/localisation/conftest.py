from tests.robots import compile_scene, description, kinematics  # noqa: F401
