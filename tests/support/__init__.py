"""What tests in several folders share: arms on a wire, running programs, small problems."""
