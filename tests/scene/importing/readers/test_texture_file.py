import numpy as np

from anm_mj.scene.importing.readers import texture_file
from anm_mj.scene.importing.readers.texture_file import limit_textures
from anm_mj.scene.submesh import Submesh


def _square(side_m: float, texture, *, tiled: bool = False) -> Submesh:
    corners = np.array([[0.0, 0.0, 0.0], [side_m, 0.0, 0.0], [side_m, side_m, 0.0], [0.0, side_m, 0.0]])
    return Submesh("square", corners, np.array([[0, 1, 2], [0, 2, 3]]), uv=corners[:, :2], texture=texture, tiled=tiled)


def _texture(side_px: int, grey: int):
    return np.full((side_px, side_px, 3), grey, dtype=np.uint8)


def test_few_small_textures_are_left_alone():
    parts = [_square(1.0, _texture(64, 100)), _square(2.0, None)]
    assert limit_textures(parts) == parts


def test_of_too_many_textures_those_on_the_least_surface_become_colours(monkeypatch, caplog):
    monkeypatch.setattr(texture_file, "MAX_TEXTURES", 2)
    parts = limit_textures([_square(side_m, _texture(8, 51)) for side_m in (3.0, 1.0, 2.0)])
    assert [part.texture is None for part in parts] == [False, True, False]
    assert parts[1].rgb == (0.2, 0.2, 0.2)
    assert "3 textures, but at most 2" in caplog.text


def test_textures_that_are_large_together_are_halved_but_for_tiles(monkeypatch, caplog):
    monkeypatch.setattr(texture_file, "MAX_TEXELS", 512 * 512 + 3 * 256 * 256)
    shared = _texture(1024, 10)
    parts = [_square(1.0, shared), _square(1.0, shared), _square(1.0, _texture(900, 20))]
    parts += [_square(1.0, _texture(512, 30), tiled=True), _square(1.0, _texture(100, 40))]
    limited = limit_textures(parts)
    assert [max(part.texture.shape) for part in limited if part.texture is not None] == [256, 256, 256, 512, 100]
    assert limited[0].texture is limited[1].texture
    assert "256 px" in caplog.text
