"""The guard of the network, and processes of ours that inherit it."""
