"""Homes of several rooms as one scene: drawn room by room, joined by doorways."""

from karma.world.houses.build import build_home, room_at, room_name, rooms_reached

__all__ = ["build_home", "room_at", "room_name", "rooms_reached"]
