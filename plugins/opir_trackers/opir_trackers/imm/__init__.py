"""The tracker `imm`: data association, IMM filter, track management and reports."""
