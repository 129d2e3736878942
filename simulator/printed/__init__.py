"""A simulated printed hobby arm (SO-101): magnetic encoders, play, flex, warm motors."""
