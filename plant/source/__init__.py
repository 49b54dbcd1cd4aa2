"""The helicopter as C sources: equations traced from :mod:`plant.dynamics`, the rest written by hand.

``equations`` makes the generated half, ``sources`` the files and the description of an export;
``helicopter.c`` and ``terrain.h`` are the half that is the same in every export.
"""
