"""What was done, on the disk: step logs, records, timings, and the folder that holds them."""
