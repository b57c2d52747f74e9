"""The MAVLink session by itself, over a socket pair: frames, noise, gaps, silence, windows."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import load_device
from esea_gen.emit.dialect import load_dialect
from esea_gen.link.frames import FrameReader
from esea_gen.link.messenger import BoardTime
from esea_gen.link.session import BOARD, HOST, Session
from esea_gen.link.transport import LinkError, ProcessTransport, SocketTransport

DIALECT = load_dialect(load_device("elbow"))
HEAD_BYTES, CHECKSUM_BYTES = 10, 2


class Peer:
    """A board made of nothing but its end of the wire."""

    def __init__(self) -> None:
        self.wire, theirs = socket.socketpair()
        self.encoder = DIALECT.MAVLink(None, *BOARD)
        self.session = Session(SocketTransport(theirs), DIALECT, timeout_s=0.2)
        self.reader = FrameReader(DIALECT)

    def frame(self, message, sequence=None):
        if sequence is not None:
            self.encoder.seq = sequence
        frame = bytes(message.pack(self.encoder))
        self.encoder.seq = (self.encoder.seq + 1) % 256
        return frame

    def say(self, *messages):
        self.wire.sendall(b"".join(self.frame(m) for m in messages))

    def heard(self):
        """What the session has sent since the last time."""
        self.wire.setblocking(False)
        try:
            return self.reader.feed(self.wire.recv(1 << 16))
        except BlockingIOError:
            return []
        finally:
            self.wire.setblocking(True)


@pytest.fixture
def peer():
    made = Peer()
    yield made
    made.session.close()
    made.wire.close()


def heartbeat(mode="REPLAY", state="ACTIVE"):
    mode, state = (getattr(DIALECT, n) for n in (f"ESEA_STATE_{mode}", f"MAV_STATE_{state}"))
    return DIALECT.MAVLink_heartbeat_message(0, 8, 1, mode, state, 3)


def info(fault=0, buffer_bytes=1024):
    zeros = [0] * 5
    return DIALECT.MAVLink_esea_info_message(
        1000, fault, *zeros, buffer_bytes, 0, 0, 0, b"0123456789abcdef", b"elbow", b"desk"
    )


def ack(command, result=0):
    return DIALECT.MAVLink_command_ack_message(command, result, 0, 0, *HOST)


def stamp():
    return DIALECT.MAVLink_esea_stamp_message(0, 7, 1000)


def output(sequence):
    cls = DIALECT.MAVLink_esea_sense_out_message
    return cls(sequence, *[1] * (len(cls.fieldnames) - 1))


def request(sequence):
    return DIALECT.MAVLink_esea_sense_in_message(sequence, 0.1), "ESEA_SENSE_OUT"


# -- frames ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("piece", [1, 2, 7, 64])
def test_frames_split_anywhere_are_put_together(peer, piece):
    stream = b"".join(peer.frame(output(k)) for k in range(20))
    reader = FrameReader(DIALECT)
    found = [m for i in range(0, len(stream), piece) for m in reader.feed(stream[i : i + piece])]
    assert [m.sequence for m in found] == list(range(20))
    assert reader.health.frames == 20
    assert reader.health.noise_bytes == reader.health.lost_frames == 0


def test_a_wrong_checksum_is_counted_and_passed_over(peer):
    # The second has a start byte inside, which is no second frame.
    good, bad, after = (bytearray(peer.frame(output(k))) for k in (0, 0x05FD, 2))
    bad[HEAD_BYTES + 4] ^= 0x40
    reader = FrameReader(DIALECT)
    assert [m.sequence for m in reader.feed(bytes(good + bad + after))] == [0, 2]
    counters = reader.health
    assert (counters.frames, counters.bad_frames, counters.unknown_frames) == (2, 1, 0)
    assert counters.noise_bytes == len(bad)
    assert counters.lost_frames == 1  # the bad one, by its number


def test_frames_that_are_missing_are_counted_for_each_sender(peer):
    reader = FrameReader(DIALECT)
    for sequence in (250, 251, 255, 0, 3, 3):
        reader.feed(peer.frame(heartbeat(), sequence))
    # 252 to 254; none from 255 to 0; 1 and 2; none for a number twice.
    assert reader.health.lost_frames == 3 + 0 + 2
    other = DIALECT.MAVLink(None, 7, 1)
    other.seq = 100
    reader.feed(bytes(heartbeat().pack(other)))
    assert reader.health.lost_frames == 5


def test_the_rest_of_a_torn_frame_hides_none_behind_it(peer):
    torn = peer.frame(output(0))[:-7]
    stream = torn + b"".join(peer.frame(output(k)) for k in (1, 2, 3))
    reader = FrameReader(DIALECT)
    assert [m.sequence for m in reader.feed(stream)] == [1, 2, 3]
    assert (reader.health.bad_frames, reader.health.noise_bytes) == (1, len(torn))


def test_messages_and_flags_that_nobody_knows_are_counted(peer):
    from pymavlink.dialects.v20 import common

    foreign = common.MAVLink_system_time_message(1, 2).pack(common.MAVLink(None, 1, 1))
    flagged = bytearray(peer.frame(heartbeat()))
    flagged[2] = 0x80
    reader = FrameReader(DIALECT)
    found = reader.feed(bytes(foreign) + bytes(flagged) + peer.frame(heartbeat()))
    assert [m.get_type() for m in found] == ["HEARTBEAT"]
    assert (reader.health.unknown_frames, reader.health.bad_frames) == (1, 1)
    assert reader.health.noise_bytes == len(foreign) + len(flagged)


@settings(max_examples=200)
@given(
    st.lists(st.binary(max_size=40) | st.lists(st.sampled_from([0xFD, 0, 1, 9])).map(bytes)),
    st.integers(1, 300),
)
def test_noise_costs_no_frame(noise, piece):
    encoder = DIALECT.MAVLink(None, *BOARD)
    frames = [bytes(output(k).pack(encoder)) for k in range(len(noise))]
    rest = bytes(300)  # more than the longest frame that noise can announce
    stream = b"".join(n + f for n, f in zip(noise, frames, strict=True)) + rest
    reader = FrameReader(DIALECT)
    found = [m for i in range(0, len(stream), piece) for m in reader.feed(stream[i : i + piece])]
    # Noise that is a frame by chance would need its checksum too: 1 in 65 536 of those with an id.
    assert [m.sequence for m in found] == list(range(len(noise)))
    assert reader.health.noise_bytes == sum(map(len, noise)) + len(rest)


# -- session ---------------------------------------------------------------------------------------


def opened(session):
    with session:
        pass


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (lambda _: b"", "silent for 0.2 s, no HEARTBEAT came. Check that it has power"),
        (lambda _: bytes(77), "but 77 bytes that are not frames. Check the baud rate"),
        (lambda p: p.frame(output(0)), "1 others of this dialect did: use a faster line"),
    ],
    ids=["silence", "noise", "no heartbeat among the frames"],
)
def test_no_heartbeat_says_what_to_do(peer, sent, said):
    peer.wire.sendall(sent(peer))
    start_s = time.monotonic()
    with pytest.raises(LinkError) as caught:
        opened(peer.session)
    assert said in str(caught.value)
    assert 0.19 < time.monotonic() - start_s < 2
    assert peer.wire.recv(1) == b""  # the wire has been let go


def test_a_heartbeat_opens_the_session_and_tells_the_mode(peer):
    peer.say(heartbeat("READY", "STANDBY"))
    with peer.session as session:
        assert session.state() == "READY"
        assert session.counters.frames == 1


def test_noise_does_not_put_off_the_end_of_waiting(peer):
    peer.session.timeout_s = 0.3
    command = [sys.executable, "-c", "import time\nwhile 1: print(flush=True); time.sleep(0.02)"]
    transport = ProcessTransport.over_stdio(command)
    start_s = time.monotonic()
    with pytest.raises(LinkError, match="no HEARTBEAT"):
        opened(Session(transport, DIALECT, timeout_s=0.3))
    assert time.monotonic() - start_s < 3


def test_what_was_not_waited_for_stays_in_order(peer):
    peer.say(output(1), heartbeat(), output(2), heartbeat("FAULT"), output(3))
    assert peer.session.wait_for("HEARTBEAT").custom_mode == DIALECT.ESEA_STATE_REPLAY
    assert peer.session.wait_for("ESEA_SENSE_OUT", wanted=lambda m: m.sequence > 1).sequence == 2
    assert peer.session.receive().sequence == 1
    left = peer.session.pending()
    assert [m.get_type() for m in left] == ["HEARTBEAT", "ESEA_SENSE_OUT"]
    assert peer.session.pending() == []
    peer.say(heartbeat())
    assert len(peer.session.pending()) == 1


def test_a_command_takes_its_own_answer(peer):
    peer.say(stamp(), ack(400, 3), ack(31010, 0))
    assert peer.session.command(31010) == DIALECT.MAV_RESULT_ACCEPTED
    question, time_of_it, sent = peer.heard()
    assert (question.boot, time_of_it.boot, sent.get_seq()) == (0, 7, time_of_it.get_seq() + 1)
    assert (sent.target_system, sent.target_component, sent.command) == (*BOARD, 31010)
    assert (sent.get_srcSystem(), sent.get_srcComponent()) == HOST


def test_a_lost_answer_is_asked_for_again_and_a_late_one_is_not_taken_for_the_next(peer):
    asked = []

    def send(data):
        asked.append(data)
        if len(asked) > 1:  # of the first the answer comes late
            peer.say(ack(512), info(), ack(512), info())

    peer.session.send_bytes = send
    peer.session.info()
    assert len(asked) == 2
    peer.session.send_bytes = lambda _: peer.say(ack(512), info(DIALECT.ESEA_FAULT_PROCESSOR))
    assert peer.session.info().fault == DIALECT.ESEA_FAULT_PROCESSOR


@pytest.mark.parametrize("order", [(31011,), (400, 1.0), (400, 0.0)])
def test_an_order_is_sent_once(peer, order):
    sent = []
    peer.session.learn_time = lambda: BoardTime(7, 1000, time.monotonic())
    peer.session.send_bytes = sent.append
    with pytest.raises(LinkError, match="no COMMAND_ACK came"):
        peer.session.command(*order)
    assert len(sent) == 1


def test_a_refused_reset_tells_the_fault(peer):
    peer.say(
        stamp(), ack(31010, DIALECT.MAV_RESULT_FAILED), ack(512), info(DIALECT.ESEA_FAULT_PROCESSOR)
    )
    with pytest.raises(LinkError, match="cannot reset: PROCESSOR: The processor took"):
        peer.session.reset()


def test_a_reset_drops_what_came_before(peer):
    peer.say(stamp(), output(5), ack(31010), heartbeat("READY", "STANDBY"))
    peer.session.reset()
    assert [m.get_type() for m in peer.session.pending()] == ["HEARTBEAT"]


def test_a_processor_that_halts_is_told_at_once(peer):
    peer.say(heartbeat("FAULT", "EMERGENCY"))
    with pytest.raises(LinkError, match="fault exception"):
        peer.session.wait_for("ESEA_SENSE_OUT")


def test_the_window_fits_the_boards_buffer(peer):
    longest = max(DIALECT.mavlink_map[i].unpacker.size for i in (42601, 42602))
    frame_bytes = HEAD_BYTES + longest + CHECKSUM_BYTES
    for buffer_bytes, frames in ((5 * frame_bytes, 4), (5 * frame_bytes + 1, 5), (10, 1)):
        peer.say(ack(512), info(buffer_bytes=buffer_bytes))
        assert peer.session.window(["ESEA_SENSE_IN", "ESEA_SENSE_OUT"]) == frames


def test_no_more_than_a_window_is_on_the_way(peer):
    answers = peer.session.exchange((request(k) for k in range(11)), window=4)
    asked = []
    for k in range(11):
        peer.say(output(k))
        assert next(answers).sequence == k
        asked += [m.sequence for m in peer.heard()]
        assert len(asked) - k <= 4
    assert asked == list(range(11))
    assert next(answers, None) is None


def test_an_answer_out_of_order_is_an_error(peer):
    peer.say(output(1))
    with pytest.raises(LinkError, match="answer 1 came in place of 0"):
        next(peer.session.exchange([request(0)], window=1))


def test_a_fault_ends_an_exchange(peer):
    peer.say(heartbeat("FAULT", "CRITICAL"), ack(512), info(DIALECT.ESEA_FAULT_STACK_EXHAUSTED))
    with pytest.raises(LinkError, match="a fault is latched: STACK_EXHAUSTED"):
        next(peer.session.exchange([request(0)], window=1))


# -- transports ------------------------------------------------------------------------------------


def test_a_peer_that_goes_away_is_told(peer):
    peer.wire.close()
    with pytest.raises(LinkError, match="the other end has closed"):
        peer.session.receive()
    with pytest.raises(LinkError, match="does not take data"):
        peer.session.send(heartbeat())


def test_a_process_speaks_through_its_standard_output_and_complains_beside_it():
    program = "import sys; sys.stdout.write('frames'); sys.stdout.flush(); sys.exit('no motor')"
    transport = ProcessTransport.over_stdio([sys.executable, "-c", program])
    try:
        assert transport.read(10.0) == b"frames"
        with pytest.raises(LinkError, match="closed the link; it said:\nno motor"):
            transport.read(10.0)
    finally:
        transport.close()


def test_closing_ends_the_process():
    program = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    transport = ProcessTransport.over_stdio([sys.executable, "-c", program])
    number = int(transport.read(10.0))
    transport.close()
    transport.close()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_the_link_needs_no_other_room_and_none_of_its_dependencies():
    program = (
        "import sys, esea_gen.link.session\n"
        "print(sorted({m for m in sys.modules if m.startswith(('esea_gen.', 'esea_host'))"
        " and not m.startswith('esea_gen.link')}"
        " | {m.split('.')[0] for m in sys.modules} & {'casadi', 'numpy', 'pymavlink'}))"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['esea_gen.portability']"  # of Python, and nothing else
