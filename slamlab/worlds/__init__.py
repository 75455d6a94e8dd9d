"""Where the robot lives. Floor 1 of the house."""

__all__: list[str] = []
