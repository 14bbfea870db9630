"""Files in and out, guarded: whatever a file holds, reading it ends in data or in one readable refusal."""
