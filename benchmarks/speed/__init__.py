"""The compiled inner loop, a generation, what comes before and beside: how long they take."""
