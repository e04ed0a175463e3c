"""What an output without a spool can lose, in words for the time before it happens."""

#: Maximum number of windows in the queue of a sink of a live run without a spool.
QUEUED_WINDOWS = 200
#: Maximum bytes of messages that wait in memory for a destination, for an output without a spool.
MEMORY_BYTES = 64 << 20

#: What is true of an output without a spool.
WITHOUT_SPOOL = (
    f"no spool: what waits for its destination is in memory (at most {MEMORY_BYTES >> 20} MiB of messages, and"
    f" {QUEUED_WINDOWS} windows of a live run) and is lost with the process; if the destination refuses events for good"
    " the output ends, and drops and counts the rest; spool: {path: FILE} keeps them"
)
