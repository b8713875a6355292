"""What is known to get past the kit: broken adapters that conform, why, and what they can do."""

from __future__ import annotations

from typing import Final, NamedTuple


class Survivor(NamedTuple):
    """Something wrong that no clause finds out.

    Attributes:
        says: what is wrong.
        why: why no trial shows it.
        can: what it can do in a mission.
    """

    says: str
    why: str
    can: str


SURVIVORS: Final = (
    Survivor(
        "Acts 60 ms late on one command in ten minutes, or in one on a wire of a busy host.",
        "1300 goals are timed in 66 s; what comes once in ten minutes is met in one run of nine, and on a wire one "
        "late goal alone may be the host's: where there is one, as many are timed again. What is under way while the "
        "host stands still does not count, and may be the one.",
        "One stop at top speed ends 13 mm later than proved; the run's monitor of A3 counts a stop that does so.",
    ),
    Survivor(
        "Loses one hand-over in a thousand, and says otherwise.",
        "60 hand-overs are driven in process, twice 26 on a wire, and 100 reports looked at.",
        "The old controller's target lives on until the next goto, which the new controller sends at once; what then "
        "still moves is met by A1 and A12.",
    ),
    Survivor(
        "Reports a charge that is off by the same amount all along, on a robot without a truth.",
        "That it falls and rises as it should is all that can be seen. Where a truth tells charges, more than a "
        "hundredth fails.",
        "The battery runs flat within what the charge is off by; the reserve is four return paths. Measure it with a "
        "meter.",
    ),
    Survivor(
        "Takes the host's wall clock for steady.",
        "The kit does not set the clock of the host that it runs on.",
        "When that clock is set, fleet time jumps or stands: renewals no longer count, and the robots stop until they "
        "are opened anew. Take `Clock.steady_s`.",
    ),
    Survivor(
        "Scales places and speeds alike, on a robot without a truth.",
        "Everything agrees with itself. Where a truth or `observe` is given this fails; without, the verdict says "
        "self-reported.",
        "Fence and boxes are elsewhere than believed. Measure a leg with a tape.",
    ),
    Survivor(
        "Has a body larger than promised, on a real robot.",
        "Robots that are not simulated are not driven into each other.",
        "Contacts at what counts as a clearance. Measure the body with a tape.",
    ),
    Survivor(
        "Never makes a connection anew that broke, or waits in a call while there is none, behind a harness without "
        "the hook `switchable`.",
        "What the kit cuts otherwise are messages; the connections to the relay stay.",
        "After a moment without network the robot is not heard any more: its lease stops it, and it is lost for the "
        "rest of the run. A call that waits holds up all robots, and their leases stop them. Pull the cable once.",
    ),
    Survivor(
        "Makes all its robots ready again when one has restarted, behind a harness without the hook `restart`.",
        "Nothing else that the kit does makes one robot of several restart.",
        "Whenever one robot restarts, all others stop within their leases and stand until they are ready again.",
    ),
    Survivor(
        "Says nothing when the simulator that its backend has started is gone, behind a harness without the hook "
        "`killable`.",
        "The kit ends no program that it has not started.",
        "A run in simulation goes on to its end with robots that have stopped, or are gone, and nobody is told why.",
    ),
    Survivor(
        "Is wrong about the fourth robot, or a later one.",
        "The kit judges the first, the second and the last of as many as `robots_most` says: 3 for shipped adapters.",
        "What the clauses are about, such as a lease that nobody watches. Let the harness open as many as you drive.",
    ),
    Survivor(
        "Does otherwise once its charge is low, behind a harness without the hook `charged`, or in what is not tried "
        "at all charges.",
        "`state.emptying` gets a robot going and stops it at all of them; the other trials begin with a tenth, and "
        "those of `state.nearly_flat` with a fifth of a hundredth. Real batteries are what they are.",
        "A robot that goes home by itself then heeds no lease: the battery's module ends most runs before. Try it "
        "with a battery that is nearly flat.",
    ),
    Survivor(
        "Sleeps for ever, or gives a link up for good, after minutes without anything to do or to hear.",
        "A robot is driven after 95 s of rest, in process after 100 s, and after 14 s in which its link is cut.",
        "It takes no goal after a long stop: it stands, and is lost for the rest of the run.",
    ),
    Survivor(
        "Lets its session, its login or its licence end after more than three minutes.",
        "No clause has a fleet open for longer: on rigid bodies an hour takes a minute.",
        "Nothing that it is told counts any more: its lease ends, it stands, and is lost for the rest of the run.",
    ),
    Survivor(
        "Tries its motors while it is made ready, and is back by then.",
        "A robot is looked at once `init()` has returned: `state.start` sees what it has moved by for good.",
        "It moves before anything watches over it. Keep away from robots that are made ready.",
    ),
    Survivor(
        "Rounds places to floats of 32 bits.",
        "The kit's rooms are 150 m from the origin, where that is 8 micrometres.",
        "20 km from the origin places are off by a millimetre; the zone of `position_noise_m` is crossed by as much.",
    ),
    Survivor(
        "Says places that are off in one part of its map, or drives worse there.",
        "The kit drives in three rooms.",
        "Fence and boxes are nearer there than believed by as much. Measure places where the robots will drive.",
    ),
    Survivor(
        "Leaves the straight segment on legs of more than 8 m.",
        "`truth.bounds.leg` drives 8 m, four times in process and twice on a wire.",
        "It leaves the segment by more than tube_m, towards what that keeps clear of. Give the harness a longer leg_m.",
    ),
    Survivor(
        "Stands still for 0.3 s twice a minute where it hears samples on a wire.",
        "Ages are judged for 8 s, and for a minute by their median: a host that is busy does the same.",
        "The sample at a tick is older than promised: that sends the robot to its safe controller, and is counted.",
    ),
    Survivor(
        "Drives worse in a narrow range of headings.",
        "Legs lead to 11 sides in process, to 5 on a wire; brakes and lease are tried along one line.",
        "What the clauses are about, such as a way beside the tube on a slope. Turn the harness's rooms.",
    ),
    Survivor(
        "Goes wrong once it has driven or turned more than the kit does.",
        "`endurance.minute` drives for 88 s in process and for 66 s on a wire, and turns by about 200 and 65 rad.",
        "What the clauses are about, such as brakes that wear; the run's monitor of A3 counts stops that are late.",
    ),
    Survivor(
        "Drives to the target of the goal before once in a hundred goals, on a wire.",
        "200 goals to other sides are looked at in process, 12 on a wire.",
        "Until the next goto it drives where it was sent before, a way that nobody has looked at from here; whoever "
        "comes near a rule by it is handed over as ever.",
    ),
    Survivor(
        "Misreads places near an axis of its frame, such as numbers with an exponent.",
        "The rooms lie off the axes; headings along them are driven, places on them are not.",
        "Where it crosses an axis its place leaps for a sample, or is kept from before: what is decided at that tick "
        "is decided by a wrong place. Let one of the harness's rooms lie across both axes.",
    ),
    Survivor(
        "Follows two programs, or takes the goals of one for those of the other; opens robots that nobody asked for; "
        "or keeps its lease over a restart, a step of its clock or a moment in which it hears nothing, behind a "
        "harness without the hooks `second`, `choosing`, `restart`, `step_clock` and `stall`.",
        "The clauses `authority.one_program`, `authority.next_program`, `several.chosen`, `deadman.restart`, "
        "`deadman.clock_back` and `deadman.stalled` are NOT TESTED then.",
        "A second program drives the robot, or one drives to where another has sent it; a robot that is not of the "
        "mission is armed; or a dead program's target lives on. Give the hooks.",
    ),
    Survivor(
        "Takes a robot from its pilot as it is closed, or leaves it armed after an outage; loses what a robot says "
        "of why it does not get ready; or counts leases by the host's time in a run that goes faster; behind a "
        "harness without the hooks `by_hand`, `shown`, `refusing` and `faster`.",
        "The clauses `authority.left`, `link.left_as_ever`, `lifecycle.says_why` and `deadman.faster` are NOT "
        "TESTED then.",
        "Somebody flies a vehicle that is disarmed, or goes up to one that is armed; or a lease lives longer than "
        "lease_s where a run is faster than real time. Give the hooks.",
    ),
    Survivor(
        "Shares what it knows among all fleets of a process, behind a harness without the hook `another`; or keeps a "
        "program of its own busy, which is not the one that imports it.",
        "No clause opens two fleets otherwise, and the time of programs that were started is not counted: simulated "
        "robots are among them.",
        "Two missions in one program move each other's robots; or ticks are late, which the run's monitors count.",
    ),
)  # fmt: skip
