"""Judges a scenario by the record of the CAN frames (candump -L), and by nothing else."""
import dataclasses
import math

MARKER = 0x7F0       # put on the bus by the simulator: event number, 1 begin or 0 end
FINISH = 0xFF        # the event number of the scenario's end: from here on the agent is stopped
METRES_PER_COUNT = math.tau * 0.033 / 4096
OPERATION_ENABLED = (0x6F, 0x27)   # statusword's mask and value, CiA 402-2 table 30
ENABLE_OPERATION = (0x0F, 0x0F)    # controlword's, table 27


def read_candump(text):
    """Yields (seconds, identifier, data) of each data frame. A jump of the machine's wall clock,
    which stamps the frames, is taken out."""
    shift, last = 0.0, None
    for line in text.splitlines():
        stamp, _, frame = line.split()
        identifier, _, data = frame.partition("#")
        if data.startswith("R"):
            continue
        time = float(stamp.strip("()")) + shift
        if last is not None and abs(time - last) > 100:
            shift += last - time
            time = last
        last = time
        yield time, int(identifier, 16), bytes.fromhex(data)


class Drive:
    """What the frames tell about one drive."""

    def __init__(self, node):
        self.node = node
        self.target = 0           # counts/s, of the last RPDO1
        self.told_to_run = False  # by its controlword
        self.enabled = False      # by the drive's own word
        self.velocity = 0         # counts/s, the drive's own word
        self.position = None
        self.counts = 0           # rolled, all in all

    def hear(self, identifier, data):
        if identifier == 0x200 + self.node:
            word = int.from_bytes(data[0:2], "little")
            self.told_to_run = word & ENABLE_OPERATION[0] == ENABLE_OPERATION[1]
            self.target = int.from_bytes(data[2:6], "little", signed=True)
        elif identifier == 0x180 + self.node:
            word = int.from_bytes(data[0:2], "little")
            self.enabled = word & OPERATION_ENABLED[0] == OPERATION_ENABLED[1]
            self.velocity = int.from_bytes(data[2:6], "little", signed=True)
        elif identifier == 0x280 + self.node:
            position = int.from_bytes(data[0:4], "little", signed=True)
            if self.position is not None:
                step = (position - self.position + 2**31) % 2**32 - 2**31
                self.counts += step if abs(step) < 5_000 else 0  # more: it was switched on again
            self.position = position
        elif identifier == 0x80 + self.node and data[0:2] != b"\0\0":
            self.enabled = False  # it says so in an emergency message before anything else

    def driven(self):
        """The last word on the bus makes the wheel turn."""
        return self.told_to_run and self.enabled and self.target != 0


@dataclasses.dataclass
class Record:
    """The run as changes: when the wheels were driven and when they stood."""
    driven: list        # (seconds, both last words: some wheel is driven)
    marks: dict         # (event number, begins) -> seconds
    end: float          # of the scenario, or of the record
    metres: float       # mean of both wheels, backward driving counts negative

    def stop_after(self, begin, end):
        """Seconds from `begin` until no wheel is driven for the rest of the time to `end`; None:
        they still are then."""
        driven, since = False, begin
        for time, now_driven in self.driven:
            if time > end:
                break
            if time <= begin:
                driven = now_driven
            elif now_driven != driven:
                driven, since = now_driven, time
        return None if driven else since - begin

    def first_drive_after(self, begin):
        """Seconds from `begin` until a wheel is driven again; None: never."""
        if self.was_driven_at(begin):
            return 0.0
        for time, driven in self.driven:
            if time > begin and driven:
                return time - begin
        return None

    def was_driven_at(self, moment):
        state = False
        for time, driven in self.driven:
            if time > moment:
                break
            state = driven
        return state

    def longest_stop(self, begin, end):
        """The longest time, in seconds, in which no wheel was driven."""
        longest, stopped = 0.0, None if self.was_driven_at(begin) else begin
        for time, driven in self.driven:
            if not begin < time <= end:
                continue
            if not driven and stopped is None:
                stopped = time
            elif driven and stopped is not None:
                longest, stopped = max(longest, time - stopped), None
        return max(longest, end - stopped) if stopped is not None else longest


def read_record(text):
    drives = [Drive(1), Drive(2)]
    driven, marks, time = [], {}, 0.0
    for time, identifier, data in read_candump(text):
        if identifier == MARKER:
            marks[data[0], bool(data[1])] = time
        for drive in drives:
            drive.hear(identifier, data)
        now = any(drive.driven() for drive in drives)
        if not driven or driven[-1][1] != now:
            driven.append((time, now))
    end = marks.get((FINISH, True), time)
    return Record(driven, marks, end, sum(d.counts for d in drives) / 2 * METRES_PER_COUNT)


@dataclasses.dataclass
class Verdict:
    what: str
    required: str
    measured: str
    good: bool


def _limit(what, value, limit, unit, scale):
    measured = "never" if value is None else f"{value * scale:.{0 if scale > 1 else 1}f} {unit}"
    return Verdict(what, f"within {limit} {unit}", measured,
                   value is not None and value * scale <= limit)


def judge_event(event, number, record):
    begin = record.marks.get((number, True))
    if begin is None:
        return [Verdict("happens", "while driving", "did not", False)]
    verdicts = []
    end = record.marks.get((number, False))
    if "stop_within_ms" in event:
        until = end if end is not None else begin + event["stop_within_ms"] / 1000
        verdicts.append(_limit("wheels stop", record.stop_after(begin, until),
                               event["stop_within_ms"], "ms", 1000))
    if "resume_within_s" in event:
        # Without an end: after the wheels have stopped.
        since = end if end is not None else begin + event["stop_within_ms"] / 1000
        verdicts.append(_limit("drive again", record.first_drive_after(since),
                               event["resume_within_s"], "s", 1))
    if "longest_stop_ms" in event:
        following = record.marks.get((number + 1, True), record.end)
        until = min(record.end, following,
                    (end if end is not None else begin) + event.get("watch_s", 5))
        verdicts.append(_limit("longest stop", record.longest_stop(begin, until),
                               event["longest_stop_ms"], "ms", 1000))
    return verdicts


def judge(scenario, candump_text):
    """Verdicts on each event, and on the distance driven in all."""
    record = read_record(candump_text)
    verdicts = []
    for number, event in enumerate(scenario.get("event", [])):
        verdicts += judge_event(event, number, record)
    least = scenario.get("least_metres", 1.0)
    verdicts.append(Verdict("driven", f"at least {least} m", f"{record.metres:.1f} m",
                            record.metres >= least))
    return verdicts
