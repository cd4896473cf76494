"""Joins a bus of `ivfm canbus` with python-can: sends one frame, prints the next two it hears."""
import sys

import can

bus = can.interface.Bus(interface="socketcand", host="127.0.0.1", port=int(sys.argv[1]),
                        channel=sys.argv[2])
bus.send(can.Message(arbitration_id=0x123, data=[0x0A, 0xB0, 0xFF], is_extended_id=False))
for _ in range(2):
    message = bus.recv(timeout=20.0)
    if message is None:
        sys.exit("nothing heard")
    print(f"{message.arbitration_id:X} {message.data.hex()}", flush=True)
bus.shutdown()
