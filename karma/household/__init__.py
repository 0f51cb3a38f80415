"""What is true of homes: object types, and the words and parts that go with them."""
