"""The MAVLink endpoints: the robots of a simulated world, each with an autopilot that behaves as ArduPilot's does.

This is the contract for programs that talk to them. It imports nothing: the vehicles are another process, started by

```
python -m soter_sim.mavlink [--udp PORT]... [--tcp PORT]... [--truth PORT] [--vehicle rover|copter]
    [--engine kinematic|pybullet] [--rate HZ] [--streams HZ] [--plain] [--speedup N] [--boot SECONDS]
    [--like ardurover|ardurover-boat|arducopter|px4] [--origin LAT,LON,ALT] [--sign FILE] [--parent PID]
```

The world comes on standard input, as `soter.sdk.wire.describe` writes it. Once all sockets are open, one line of JSON
is printed: `{"links": ["udpin:127.0.0.1:14550", ...], "truth": "127.0.0.1:PORT", "robots": [1, 2]}`. With
`--parent` the process ends when that one is no longer its parent; SIGINT and SIGTERM end it with code 0. A bad argument
or world ends it with code 2 and one line on standard error. Only 127.0.0.1 is ever used.

**Links.** `--udp PORT`: the vehicles are clients and send to PORT, on which a ground station listens, all of them from
one socket; packets from elsewhere are dropped. `--tcp PORT`: the vehicles listen, for any number of ground stations;
port 0 takes a free one. Both may be repeated. The addresses printed are in pymavlink's form; MAVSDK's is
`udpin://127.0.0.1:PORT` and `tcpout://127.0.0.1:PORT`. MAVLink 2; with `--sign` packets are signed with SHA-256 of the
passphrase, and others are dropped.

**Identity.** System id = robot id, component id 1. A message with target system 0 is for every vehicle; one for another
system is ignored. The target component is not checked. Acknowledgements go to the sender, on its link.

**Time.** `time_boot_ms` and all other times are the vehicle's: 0 at boot, `--speedup` seconds by second at most. The
vehicles live in control periods of 1/40 s (`--rate`; PyBullet has 1/20 s): states are those at the end of a period,
with its stamp, sent at once; messages received act from the next period on. Delays of a busy host are made up for, up
to 0.25 s of the vehicles' time; a host that lags for longer slows them down. No message is sent more than once a
period, or `--streams` times a second: SET_MESSAGE_INTERVAL is DENIED if it asks for more. TIMESYNC is answered with
the clock between two periods. A reboot (MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, disarmed only unless the sixth parameter is
20190226) restarts the clock and forgets message intervals, keeper and home; parameters and mission stay.

**Boot.** `--boot S`: HEARTBEAT from S/21, a position (whose height is 584 m off) from S/4, EKF_STATUS_REPORT 831
instead of 167 and correct positions from S on. Arming and modes that need a position are refused until then.

**Frames.** The origin of the EKF is the origin of the workspace: LOCAL_POSITION_NED is x = north, y = east, z = down
from there. On earth it is 47.397742 N, 8.545594 E, 488 m, or `--origin`; GPS_GLOBAL_ORIGIN says it; a metre is
1/0.011131884502145034 units of 1e-7 degrees. In a workspace with places on earth, metres are those of the ellipsoid; an
EKF has its origin where its vehicle has booted, and makes metres of latitude and longitude as ArduPilot does.

**Charge.** BATTERY_STATUS: `battery_remaining` is whole per cent; `current_consumed` is (1 - charge) x BATT_CAPACITY
(10 000 mAh), so 1e-4 fine.

**Targets** (SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_INT; never acknowledged; dropped in silence outside GUIDED or when
disarmed, with a STATUSTEXT when a number in use is not finite). A position (mask bits 0-2 clear) is driven to as
`soter.onboard.drive` does: brake, pivot, straight, stop; a later one replaces it, and one nearly along the motion is
steered to without stopping. While SOTER_YAW_SPEED is 1, which is the default and more than ArduPilot's rover does, a
yaw (bit 10 clear) is arrived with, backwards where that is nearer, and a velocity beside a position (bits 3-5 clear)
caps the speed by its horizontal length. A velocity alone is kept for 3 s of vehicle time; so is a yaw alone, to which a
rover turns in place. Copters must have taken off
(MAV_CMD_NAV_TAKEOFF).

**Authority and lease.** At first, all senders' targets are obeyed, as on any autopilot. MAV_CMD_DO_GUIDED_MASTER (221)
changes that:

- param1, param2: system and component of the *master*. Only its targets are obeyed, in GUIDED; others are dropped in
  silence. A target whose packet number shows that a later one has been taken is dropped too. Naming another master
  drops the target, and the vehicle brakes. 0, 0 ends all this: no master, no keeper, no lease, no target.
- Its sender becomes the *keeper*. While the lease lives, only the keeper may send it: others get DENIED.
- Every DO_GUIDED_MASTER of the keeper, also one that changes nothing, renews the lease, and nothing else does: no
  target, no heartbeat. The lease lasts SOTER_LEASE_MS (default 250, 50 to 5000) of vehicle time. It counts from param5
  (`x` of a COMMAND_INT, exact), the `time_boot_ms` at which the sender renewed it, or from arrival if that is 0; a time
  in the future counts as now. A renewal older than the last one taken was overtaken: it changes nothing, and is
  TEMPORARILY_REJECTED.
- While the lease is dead, the target is held and moves nothing; it moves the vehicle again when the lease is renewed,
  because the keeper only renews it after judging the vehicle safe.
- A component that was named master by a keeper other than itself is a *subordinate*: it may only send targets, and
  requests for messages, parameters and missions. Everything else is DENIED, until 0, 0 or a reboot, also while the
  lease is dead.
- While the lease lives, programs that are neither keeper nor subordinate may stop the vehicle (HOLD; BRAKE, LOITER,
  LAND; disarm) and ask for messages; everything else is DENIED. When it is dead, they may do all that is possible
  without a keeper.
- NAMED_VALUE_INT `GMASTER` (request or stream 252) is 256 x system + component of the master, with a minus while the
  lease is dead, and 0 without a master. It is broadcast at once when it changes. POSITION_TARGET_LOCAL_NED (85) echoes
  the target while there is one, whether or not it moves the vehicle.

With `--plain` there is none of this, as on a real ArduPilot: DO_GUIDED_MASTER is UNSUPPORTED, the parameters and
NAMED_VALUE_INT are missing, and yaw and speed of a rover's positions are ignored.

Ids are only claimed by senders: this keeps a controller from moving a vehicle by mistake or out of turn, but not one
that pretends to be the supervisor. The link has to restrict who may send at all.

So a supervisor sends from one component (say 191), names itself for the SC and another (say 192) for the AC, and the AC
sends targets from there.

**Truth.** Lines of JSON over TCP on `truth`, one a control period, as `soter_sim.truth_server` writes and
`soter.sdk.truth.StreamedTruth` reads them. Its times are the world's, which are not those of a vehicle that has
rebooted. A copter is reported as seen from above, with its speed along its heading.
"""
