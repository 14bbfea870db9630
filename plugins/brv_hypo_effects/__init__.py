"""Effects that the residual loop tries, moments and errors of the record, and the processes of every hypothesis."""
