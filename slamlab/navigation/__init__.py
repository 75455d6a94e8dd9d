"""Where the robot goes: routes, paths remembered and followed, exploration. Floor 4."""

__all__: list[str] = []
