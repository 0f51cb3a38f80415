"""Task files of ours and of others, read and checked."""
