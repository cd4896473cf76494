#!/usr/bin/env python3
"""`ivfm serve` as a process: its metrics, a graceful stop, a kill, and that it goes on afterwards.

Usage: serve_process_test.py IVFM EMULATED_FLEET
"""
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import urllib.request

from prometheus_client.parser import text_string_to_metric_families

ROBOTS = 3


class Server:
    def __init__(self, ivfm, database):
        command = [ivfm, "serve", "--listen", "127.0.0.1:0", "--db", database, "--http", "0",
                   "--retention", "1h"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.udp = re.search(r"listening on (\S+),", self.process.stdout.readline())[1]
        self.http = re.search(r"live page (\S+/)", self.process.stdout.readline())[1]

    def metrics(self):
        """Sample by name and labels, as Prometheus' own parser reads them."""
        with urllib.request.urlopen(self.http + "metrics", timeout=20) as answer:
            assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
            text = answer.read().decode()
        samples = {}
        for family in text_string_to_metric_families(text):
            assert family.documentation and family.type != "unknown", family
            for sample in family.samples:
                key = sample.name + "".join(f"/{v}" for v in sample.labels.values())
                assert key not in samples, key
                samples[key] = sample.value
        return samples

    def wait_for(self, what, condition, seconds=60):
        end = time.monotonic() + seconds
        while True:
            metrics = self.metrics()
            if metrics and condition(metrics):
                return metrics
            assert time.monotonic() < end, f"still not so after {seconds} s: {what}\n{metrics}"
            time.sleep(0.1)

    def end(self, signal_number):
        self.process.send_signal(signal_number)
        return self.process.wait(30)


def query(database, sql):
    connection = sqlite3.connect(f"file:{database}?mode=ro", uri=True)
    rows = connection.execute(sql).fetchall()
    connection.close()
    return rows


def check_metrics(metrics):
    assert metrics["ivfm_robots"] == ROBOTS
    assert all(0 <= metrics[f"ivfm_robot_silence_seconds/{i}"] < 60 for i in (1, 2, 3))
    assert metrics["ivfm_radio_bytes_total/in"] > 28 * metrics["ivfm_radio_datagrams_total/in"] > 0
    assert metrics["ivfm_radio_dropped_total/malformed"] == 0
    assert metrics["ivfm_tiles"] > 0 and metrics["ivfm_database_bytes"] > 0
    count = metrics["ivfm_commit_seconds_count"]
    assert count > 0 and metrics["ivfm_commit_seconds_bucket/+Inf"] == count
    assert 0 < metrics["ivfm_commit_seconds_bucket/0.5"] <= count
    assert metrics["process_resident_memory_bytes"] > 1e6 and metrics["process_cpu_seconds_total"] > 0


def check_stop(ivfm, fleet, database):
    """A graceful stop commits what has come and says so in the database."""
    server = Server(ivfm, database)
    robots = subprocess.Popen([fleet, server.udp, str(ROBOTS), "120"])
    try:
        metrics = server.wait_for("three robots' cells are durable",
                                  lambda m: m["ivfm_robots"] == ROBOTS
                                  and m["ivfm_updates_durable_total"] > 20
                                  and m["ivfm_cells/visits"] > 5000)
    finally:
        robots.kill()
        robots.wait()
    check_metrics(metrics)
    assert server.end(signal.SIGTERM) == 0
    assert query(database, "SELECT ended_unix_us FROM sessions")[-1][0] is not None


def check_kill(ivfm, database):
    """After a kill the next server has the same map, at once."""
    for signal_number in (signal.SIGKILL, signal.SIGTERM):
        server = Server(ivfm, database)
        stored = query(database, "SELECT count(*) FROM tiles")[0][0]
        metrics = server.wait_for("the map is loaded", lambda m: m["ivfm_tiles"] > 0)
        assert metrics["ivfm_tiles"] == stored and metrics["ivfm_robots"] == ROBOTS
        server.end(signal_number)
    ends = [row[0] for row in query(database, "SELECT ended_unix_us FROM sessions")]
    assert [end is None for end in ends] == [False, True, False], ends


def main():
    ivfm, fleet = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        check_stop(ivfm, fleet, folder + "/run.db")
        check_kill(ivfm, folder + "/run.db")


main()
