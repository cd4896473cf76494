"""The judge on short records whose verdict is plain to see."""
import unittest

import judge

RUNS = "0F00E8030000"      # controlword enable operation, 1,000 counts/s
STANDS = "0F0000000000"
ENABLED = "3706E8030000"   # statusword operation enabled
FAULT = "180200000000"
EVENT = {"stop_within_ms": 100, "resume_within_s": 2}


def record(*frames):
    """A candump text from (milliseconds, identifier, data)."""
    return "".join(f"({1000 + ms / 1000:.6f}) can1 {frame}\n" for ms, frame in frames)


def drive(ms, left=RUNS, right=RUNS, status=ENABLED):
    return [(ms, f"181#{status}"), (ms, f"182#{status}"), (ms, f"201#{left}"),
            (ms, f"202#{right}")]


def verdicts(event, *frames):
    scenario = {"event": [event], "least_metres": 0}
    return [verdict.good for verdict in judge.judge(scenario, record(*frames))[:-1]]


class JudgeTest(unittest.TestCase):
    def test_a_stop_in_time_and_a_new_start_pass(self):
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(90, STANDS, STANDS),
                                  (500, "7F0#0000"), *drive(1500)), [True, True])

    def test_a_late_stop_fails(self):
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(130, STANDS, STANDS),
                                  (500, "7F0#0000"), *drive(1500)), [False, True])

    def test_one_wheel_that_is_still_driven_is_no_stop(self):
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(90, STANDS, RUNS),
                                  (500, "7F0#0000"), *drive(1500))[0], False)

    def test_a_wheel_that_starts_again_during_the_fault_is_no_stop(self):
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(90, STANDS, STANDS),
                                  *drive(300), (500, "7F0#0000"), *drive(1500))[0], False)

    def test_quick_stop_counts_whatever_the_target_is(self):
        stop = "0200E8030000"
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(50, stop, stop),
                                  (500, "7F0#0000"), *drive(1500)), [True, True])

    def test_a_drive_that_says_it_is_not_enabled_is_stopped(self):
        for words in ((f"181#{FAULT}", f"182#{FAULT}"), ("081#3081000000000000",
                                                         "082#3081000000000000")):
            self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), (80, words[0]),
                                      (80, words[1]), (500, "7F0#0000"), *drive(1500)),
                             [True, True])

    def test_never_starting_again_fails(self):
        self.assertEqual(verdicts(EVENT, *drive(0), (10, "7F0#0001"), *drive(50, STANDS, STANDS),
                                  (500, "7F0#0000"), (9000, "080#")), [True, False])

    def test_an_event_that_did_not_happen_fails(self):
        self.assertEqual(verdicts(EVENT, *drive(0), *drive(50, STANDS, STANDS)), [False])

    def test_the_longest_stop_is_measured_and_limited(self):
        event = {"longest_stop_ms": 200, "watch_s": 1}
        stop = [*drive(0), (10, "7F0#0001"), *drive(100, STANDS, STANDS), *drive(290),
                (1200, "080#")]
        self.assertEqual(verdicts(event, *stop), [True])
        event["longest_stop_ms"] = 180
        self.assertEqual(verdicts(event, *stop), [False])

    def test_what_follows_an_event_is_not_held_against_it(self):
        stopped_for_good = [*drive(0), (10, "7F0#0001"), (100, "7F0#0000"),
                            *drive(600, STANDS, STANDS), (5000, "080#")]
        event = {"longest_stop_ms": 200}
        self.assertEqual(verdicts(event, *stopped_for_good), [False])
        for mark in ("7F0#FF01", "7F0#0101"):  # the scenario's end, the next event
            self.assertEqual(verdicts(event, *stopped_for_good[:-5], (500, mark),
                                      *stopped_for_good[-5:]), [True])

    def test_a_jump_of_the_clock_is_taken_out(self):
        text = record(*drive(0), (10, "7F0#0001"))
        text += record(*drive(3_600_010, STANDS, STANDS), (3_600_500, "7F0#0000"),
                       *drive(3_601_000))
        verdict = judge.judge({"event": [EVENT]}, text)[0]
        self.assertEqual((verdict.measured, verdict.good), ("0 ms", True))

    def test_metres_are_the_mean_of_both_wheels_and_survive_a_wrap(self):
        frames = []
        for node, step in ((1, 4096), (2, 2048)):
            for turn in range(3):
                position = (2**31 - 1 + turn * step) % 2**32
                frames.append((turn, f"28{node}#{position.to_bytes(4, 'little').hex()}"))
        self.assertAlmostEqual(judge.read_record(record(*frames)).metres, 1.5 * 0.20735, 3)


if __name__ == "__main__":
    unittest.main()
