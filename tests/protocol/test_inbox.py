"""A process that waits for the network hears its signals."""

import signal
import threading
import time

from protocol.inbox import SIGNAL_S, Arrival, Inbox


def test_a_signal_that_another_thread_receives_ends_a_wait_without_limit() -> None:
    inbox, heard = Inbox(), threading.Event()

    def receive() -> None:
        time.sleep(0.1)
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)
        if not heard.wait(10 * SIGNAL_S):
            inbox.put(Arrival("too late"))

    before = signal.signal(signal.SIGUSR1, lambda number, frame: inbox.stop())
    receiver = threading.Thread(target=receive)
    receiver.start()
    try:
        assert inbox.next().what == Inbox.STOP
    finally:
        heard.set()
        receiver.join()
        signal.signal(signal.SIGUSR1, before)
