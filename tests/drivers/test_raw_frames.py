"""Raw frames as recorders get them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.sample import RawFrame, raw_frames

times = st.integers(-(2**63), 2**63 - 1)
directions = st.sampled_from(["rx", "tx", "link"])
frames = st.lists(
    st.builds(RawFrame, times, times, directions, st.sampled_from(["serial", "can"]), st.binary())
)


@given(frames)
def test_they_come_back_from_one_payload(frames):
    assert raw_frames(b"".join(frame.to_bytes() for frame in frames)) == frames


@pytest.mark.parametrize("cut", [1, 21, 25, -1])
def test_a_payload_cut_short_is_an_error(cut):
    payload = RawFrame(1, 2, "rx", "serial", b"bytes").to_bytes()
    with pytest.raises(ValueError, match="raw frames"):
        raw_frames(payload[:cut])
