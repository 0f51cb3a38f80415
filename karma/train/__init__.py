"""What the nano models learn from, and how."""
