"""Choose the likeliest of a closed list of texts, token by token, whoever tells the chances."""
