"""Threads, processes, pickling, Ctrl-C and memory."""

import concurrent.futures
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time

import numpy as np

import deaflow

SCENE = deaflow.Scene.read("plain.yaml")
PATTERNS = np.load("patterns.npy")


def solve(scene, pattern):
    return scene.solve(pattern)


def expect_equal(results, expected):
    for k, result in enumerate(results):
        assert np.array_equal(result.displacement[0], expected.displacement[k % len(PATTERNS)])


def threads_and_processes():
    expected = SCENE.solve(PATTERNS)
    each = [PATTERNS[k % len(PATTERNS)] for k in range(12)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        expect_equal(pool.map(lambda pattern: solve(SCENE, pattern), each), expected)
    # A forked process has none of the threads that have worked here.
    for method in ("fork", "spawn"):
        context = multiprocessing.get_context(method)
        with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
            expect_equal(pool.map(solve, [SCENE] * 4, each[:4], timeout=60), expected)


def other_threads_run():
    scene = deaflow.Scene.read("plain.yaml", {"geometry.cells": 60})
    patterns = np.random.default_rng(5).integers(0, 2, (6, 60, 60))
    counted, done = 0, threading.Event()

    def work():
        scene.solve(patterns, elements_per_cell=4, order=2)
        done.set()

    thread = threading.Thread(target=work)
    thread.start()
    while not done.wait(0.001):
        counted += 1
    thread.join()
    assert counted > 20, counted


def pickling():
    copy = pickle.loads(pickle.dumps(SCENE))
    assert copy == SCENE and hash(copy) == hash(SCENE) and copy is not SCENE and copy.text == SCENE.text
    assert copy != deaflow.Scene.read("plain.yaml", {"drive.voltage": "1 kV"})
    result = copy.solve(PATTERNS)
    again = pickle.loads(pickle.dumps(result))
    assert list(again) == list(result) and again.units == result.units and again.attributes == result.attributes
    assert all(np.array_equal(again[name], result[name], equal_nan=result[name].dtype.kind == "f") for name in result)
    try:
        deaflow.Scene({"geometry": {}})
        assert False
    except deaflow.Error as error:
        again = pickle.loads(pickle.dumps(error))
        assert str(again) == str(error) and again.code == error.code == 2 and again.help == error.help


def interrupt():
    scene = deaflow.Scene.read("plain.yaml", {"geometry.cells": 200})
    patterns = np.random.default_rng(6).integers(0, 2, (200, 200, 200))
    # Covered cells need factors of a matrix, which are not interrupted. Those of a path on 200 x 200 cells take longer
    # than the exception may: they are left to themselves.
    small = deaflow.Scene.read("plain.yaml", {"geometry.cells": 50})
    expected = SCENE.solve(PATTERNS)
    objective = {"point": ["20 mm", "20 mm"], "direction": "0 deg"}
    calls = [
        lambda: scene.solve(patterns, elements_per_cell=2, order=2),
        lambda: small.value_and_gradient(patterns[:, :50, :50], objective, elements_per_cell=1, order=2),
        lambda: scene.path(patterns[0]),
    ]
    for call in calls:
        sent = []

        def send():
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Timer(1.5, send)
        timer.start()
        try:
            call()
            raise SystemExit("not interrupted")
        except KeyboardInterrupt:
            waited = time.monotonic() - sent[0]
        assert waited < 1.0, waited
        print(f"interrupted after {waited:.2f} s", file=sys.stderr)
    again = SCENE.solve(PATTERNS)
    assert np.array_equal(again.displacement, expected.displacement)


def interrupt_here():
    """After a quick one, a single pattern is solved on the main thread. Handlers of signals may simulate there too."""
    changes = {"geometry.cells": 50, "drive.voltage": "7.5 kV", "effects.electromechanical_stability": {}}
    scene = deaflow.Scene.read("plain.yaml", changes)
    patterns = [np.zeros((50, 50), dtype=int), np.random.default_rng(6).integers(0, 2, (50, 50))]
    expected, nested, sent = SCENE.solve(PATTERNS[0]), [], []

    def handler(*_):
        nested.append(SCENE.solve(PATTERNS[0]))
        nested.append(scene.solve(patterns[0], elements_per_cell=1))
        if len(nested) == 4:
            raise KeyboardInterrupt

    def send():
        for _ in range(2):
            time.sleep(0.5)
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, handler)
    thread = threading.Thread(target=send)
    thread.start()
    try:
        while True:
            for pattern in patterns:
                scene.solve(pattern, elements_per_cell=1)
    except KeyboardInterrupt:
        waited = time.monotonic() - sent[1]
    thread.join()
    signal.signal(signal.SIGINT, before)
    assert waited < 1.0, waited
    for result in [nested[0], nested[2], SCENE.solve(PATTERNS[0])]:
        assert np.array_equal(result.displacement, expected.displacement)


def interrupt_design():
    """A search runs in a process of its own, which the signal to this one does not reach."""
    scene = deaflow.Scene.read("plain.yaml", {"geometry.cells": 50})
    objective = {"point": ["20 mm", "20 mm"], "direction": "0 deg"}
    sent = []

    def send():
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    for callback in [None, lambda line: None]:
        timer = threading.Timer(2.0, send)
        timer.start()
        try:
            scene.design(objective, area=0.5, evaluator="newton", seed=1, callback=callback)
            raise SystemExit("not interrupted")
        except KeyboardInterrupt:
            waited = time.monotonic() - sent[-1]
        # The process ends with it: what is running is finished, and kept.
        assert waited < 3.0, waited
        print(f"interrupted after {waited:.2f} s", file=sys.stderr)


def memory():
    def pages():
        return int(open("/proc/self/statm").read().split()[1])

    def use(count):
        for k in range(count):
            scene = deaflow.Scene.read("plain.yaml", {"drive.voltage": f"{1000 + k} V", "geometry.cells": 4})
            scene.solve(np.ones((4, 4), dtype=int))

    use(100)
    before = pages()
    use(400)
    grown = (pages() - before) * os.sysconf("SC_PAGE_SIZE") / 2**20
    assert grown < 20, grown


if __name__ == "__main__":
    {f.__name__: f for f in (threads_and_processes, other_threads_run, pickling, interrupt, interrupt_here, interrupt_design, memory)}[sys.argv[1]]()
