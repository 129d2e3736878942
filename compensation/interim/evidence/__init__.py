"""How much likelier all checks are with a change than without, and which checks are bad."""
