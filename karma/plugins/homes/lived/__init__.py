"""Days of family life: memory designs in homes where people live, judged by the world."""
