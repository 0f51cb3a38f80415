"""What was done, on the disk: step logs, records, the folder of a run or a talk."""
