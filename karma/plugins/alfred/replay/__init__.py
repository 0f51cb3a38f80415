"""Read ALFRED's demonstrations, build their scenes, replay them, and judge the outcome."""
