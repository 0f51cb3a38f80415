"""What people's words mean: phrases of a sentence, and which types and deeds they come near to."""
