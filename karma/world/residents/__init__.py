"""The people in a home: their habits, their deeds in the world, and the log of truth."""

from karma.world.residents.household import ACTION_S, Household, Resident, resting_places, states_of

__all__ = ["ACTION_S", "Household", "Resident", "resting_places", "states_of"]
