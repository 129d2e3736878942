"""A printed hobby arm (SO-101) that is not there: magnetic encoders, play, flex, warm motors."""
