"""The maker's own software speaks with the board: ping, read, write."""

from __future__ import annotations

import dynamixel_sdk as sdk

from firmware.simulator.simulation import FirmwareSimulation
from tests.support.firmware_host import HOLD_S, Bench
from tsd_twin.hardware.dynamixel.control_table import ADDRESS, BOARD_ID, FW_VERSION, MODEL, Setup


class SimulationPort:
    """Simulation behind the port interface of the SDK; its time passes while the SDK waits."""

    def __init__(self, simulation: FirmwareSimulation) -> None:
        self.is_using = False
        self._simulation = simulation
        self._received = b""
        self._deadline_s = 0.0

    def clearPort(self) -> None:  # noqa: N802  The SDK's name.
        self._received = b""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self._simulation.board.send(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        self._simulation.run(0.0005)
        self._received += self._simulation.board.receive()
        taken, self._received = self._received[:length], self._received[length:]
        return taken

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        self._deadline_s = self._simulation.board.now_s + 0.02 + length * 1e-5

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return self._simulation.board.now_s > self._deadline_s


def test_the_makers_software_pings_reads_and_writes(bench: Bench) -> None:
    pilot = bench.pilot()
    pilot.simulation.run(HOLD_S)
    port, handler = SimulationPort(pilot.simulation), sdk.Protocol2PacketHandler()
    assert handler.ping(port, BOARD_ID) == (MODEL, sdk.COMM_SUCCESS, 0)
    assert handler.read1ByteTxRx(port, BOARD_ID, ADDRESS["fw"]) == (FW_VERSION, 0, 0)
    assert handler.read4ByteTxRx(port, BOARD_ID, ADDRESS["host_baud"]) == (1_000_000, 0, 0)
    assert handler.write2ByteTxRx(port, BOARD_ID, ADDRESS["neutral"], 2000) == (0, 5)
    for neutral in (0, 1234, 4095):
        data = list(Setup(neutral=(neutral,) * 6).pack())
        assert handler.writeTxRx(port, BOARD_ID, Setup.ADDRESS, len(data), data) == (0, 0)
        assert handler.read2ByteTxRx(port, BOARD_ID, ADDRESS["neutral"]) == (neutral, 0, 0)
    data = list(Setup(neutral=(4096,) * 6).pack())
    assert handler.writeTxRx(port, BOARD_ID, Setup.ADDRESS, len(data), data) == (0, 4)
    assert handler.write1ByteTxRx(port, BOARD_ID, ADDRESS["mode"], 1) == (0, 7)
    setup = Setup(neutral=(2000, 2010, 2020, 2030, 2040, 2050), reverse=5, goal_limit=100)
    data = list(setup.pack())
    assert handler.writeTxRx(port, BOARD_ID, Setup.ADDRESS, len(data), data) == (0, 0)
    read, result, error = handler.readTxRx(port, BOARD_ID, Setup.ADDRESS, len(data))
    assert (Setup.unpack(bytes(read)), result, error) == (setup, 0, 0)
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
