"""Makes scenes/home anew: the furnished house that comes with the project.

Run it from the repository root: ``python scripts/make_home.py``.
"""

from pathlib import Path

from anm_mj.scene.home.house import make_home

scene = make_home(Path("scenes") / "home")
size_mib = sum(file.stat().st_size for file in scene.folder.rglob("*") if file.is_file()) / 2**20
print(f"{scene.folder}: {scene.rooms} rooms, {scene.num_triangles} triangles, {size_mib:.1f} MiB")
