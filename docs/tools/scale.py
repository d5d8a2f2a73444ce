"""Estimates the load of a thousand workers on one shared file system by a discrete-event simulation.

    deaflow doctor --store DIR --measure --json | python3 docs/tools/scale.py

Reads the time of each service on the file system of a store, and simulates workers that build the chunks of one stage: each looks for a
free chunk, claims it, computes, publishes the artifact and writes its record. At its start and after the last chunk a worker checks what exists:
the records of all chunks, or only their names; in the second case one of the workers reads the records and
assembles the stage. The file system serves several requests at a time and the others wait; a request takes at least one
round trip. The model has no caches and no other users.
"""

import argparse
import heapq
import json
import random
import sys

# Maximum number of blocks of a stage, as in src/orchestrator/reserve.rs.
BLOCKS = 10_000


class Server:
    """A file system that serves `width` services at a time."""

    def __init__(self, times, requests, width, way):
        self.times, self.requests, self.way = times, requests, way
        self.free = [0.0] * width
        self.busy = 0.0
        self.asked = 0

    def serve(self, now, name, count=1):
        """Returns the time at which `count` services requested at `now` are done."""
        at = heapq.heappop(self.free)
        work = count * self.times[name]
        start = max(now, at)
        heapq.heappush(self.free, start + work)
        self.busy += work
        self.asked += count * self.requests[name]
        return start + work + count * self.requests[name] * self.way

    def names(self, now, count):
        """Returns the time at which `count` names in 256 folders are listed; a folder with fewer names counts as one with a thousand."""
        return self.serve(now, "list 1000 names", max(256, count // 1000))


def free(after, at):
    """Returns the first free block from `at` on, or the number of blocks if there is none."""
    first = at
    while after[first] != first:
        first = after[first]
    while after[at] != first and after[at] != at:
        after[at], at = first, after[at]
    return first


def simulate(services, workers, chunks, seconds, block, width, way, spread, looks, threads):
    """Builds all chunks. `block` chunks are reserved at once; 1: each is claimed when it is reached. `spread`: workers start at different
    blocks. `looks`: what workers check: "none", "records" of all chunks, or their "names". Returns the total time and the statistics of the
    server."""
    times = {service["name"]: service["seconds"] for service in services}
    requests = {service["name"]: service["requests"] for service in services}
    server = Server(times, requests, width, way)
    draw = random.Random(1)
    blocks = (chunks + block - 1) // block
    place = [draw.randrange(blocks) if spread else 0 for _ in range(workers)]
    looked = [0] * workers  # blocks that the worker has passed over
    after = list(range(blocks + 1))  # the next free block from here on
    left = [0] * workers  # chunks of the worker's block that are not started
    own = [0] * workers
    built = refused = 0
    chosen = None  # the worker that assembles the stage
    complete = None  # the time of completion
    # Next events of the workers in the order of time, so that the server receives requests in that order.
    events = [(0.0, worker, "begin") for worker in range(workers)]
    end = 0.0
    while events:
        now, worker, step = heapq.heappop(events)
        if step == "begin":
            if looks == "records":
                now = server.serve(now, "read a record", chunks)
            elif looks == "names":
                now = server.names(now, built)
            heapq.heappush(events, (now, worker, "look"))
        elif step == "look" and left[worker] == 0:
            # Consecutive claimed blocks are refused one by one; the server handles them together.
            at = (place[worker] + looked[worker]) % blocks
            count = min(free(after, at) - at, blocks - looked[worker])
            looked[worker] += count
            if count:
                refused += count
                heapq.heappush(events, (server.serve(now, "claim held by another worker", count), worker, "look"))
            elif looked[worker] < blocks:
                at = (place[worker] + looked[worker]) % blocks
                looked[worker] += 1
                after[at] = at + 1
                left[worker] = min(chunks, (at + 1) * block) - at * block
                done = server.serve(now, "claim") if block > 1 else now
                heapq.heappush(events, (done, worker, "look"))
            elif looks == "records":
                # Chunks of other workers are claimed briefly and found finished.
                others = chunks - own[worker]
                done = max(server.serve(now, "read a record", others), server.serve(now, "claim", others))
                end = max(end, done)
            elif looks == "names":
                heapq.heappush(events, (server.names(now, built), worker, "wait"))
        elif step == "wait" and chosen is None:
            chosen = worker
            heapq.heappush(events, (server.serve(now, "claim"), worker, "assemble"))
        elif step == "wait" and complete is None:
            # The delay depends on the time waited so far; this is its maximum.
            heapq.heappush(events, (server.serve(now, "claim held by another worker") + 5, worker, step))
        elif step == "wait":
            # The manifest: 32 bytes per chunk, counted as artifacts.
            size = max(1, chunks * 32 // 200_000)
            end = max(end, server.serve(server.serve(now, "claim"), "publish an artifact", size))
        elif step == "assemble" and built < chunks:
            heapq.heappush(events, (now + 1, worker, step))
        elif step == "assemble":
            # Its threads share the work: read the record, and half as much again to check that the artifact exists.
            others = 3 * (chunks - own[worker]) // (2 * threads)
            done = max(server.serve(now, "read a record", others) for _ in range(threads))
            heapq.heappush(events, (done, worker, "complete"))
        elif step == "complete":
            complete = end = now
        elif step == "look":
            left[worker] -= 1
            heapq.heappush(events, (server.serve(now, "claim"), worker, "compute"))
        elif step == "compute":
            heapq.heappush(events, (now + draw.uniform(0.8, 1.2) * seconds, worker, "publish an artifact"))
        elif step == "publish an artifact":
            heapq.heappush(events, (server.serve(now, step), worker, "write a record"))
        else:
            heapq.heappush(events, (server.serve(now, step), worker, "look"))
            built += 1
            own[worker] += 1
            end = max(end, now)
    assert built == chunks, f"{built} of {chunks}"
    return end, server, refused


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--seconds", type=float, default=20, help="computing time of a chunk [20]")
    words.add_argument("--chunks", type=int, default=100_000, help="chunks of the stage [100000]")
    words.add_argument("--width", type=int, default=8, help="services at a time [8]")
    words.add_argument("--way", type=float, default=0.5, help="round trip to the server, ms [0.5]")
    words.add_argument("--threads", type=int, default=4, help="reading threads of a worker [4]")
    words.add_argument("--workers", type=int, nargs="+", default=[10, 100, 1000], help="numbers of workers [10 100 1000]")
    words.add_argument("--slow", type=float, default=1, help="factor on the measured times [1]")
    given = words.parse_args()
    services = json.load(sys.stdin)["services"]
    for service in services:
        service["seconds"] *= given.slow
    print("workers  claims            hours  of ideal  requests/s  server busy  refused claims")
    for workers in given.workers:
        block = max(1, given.chunks // BLOCKS)
        for name, block, spread, looks in [
            ("chunk by chunk", 1, False, "none"),
            (f"blocks of {block}", block, True, "none"),
            ("... and records", block, True, "records"),
            ("... and names", block, True, "names"),
        ]:
            width, way = given.width, given.way / 1e3
            end, server, refused = simulate(
                services, workers, given.chunks, given.seconds, block, width, way, spread, looks, given.threads
            )
            ideal = given.chunks * given.seconds / workers
            print(
                f"{workers:7}  {name:15}  {end / 3600:6.2f}  {end / ideal:8.2f}  {server.asked / end:10.0f}"
                f"  {server.busy / end / given.width:10.1%}  {refused:14}"
            )


main()
