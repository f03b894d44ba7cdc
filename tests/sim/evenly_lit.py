"""Worlds for tests of cameras: only ambient light, so that every pixel has the colour of its geom."""

HEADER = """
  <statistic extent="1"/>
  <visual>
    <headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
    <map znear="0.02" zfar="50"/>
  </visual>
"""
