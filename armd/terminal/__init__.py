"""What a person types and reads: command lines, what was meant, what is said beside a result."""
