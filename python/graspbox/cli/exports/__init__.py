"""Commands and options that write results in the formats of other programs, one module each."""
