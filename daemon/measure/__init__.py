"""Guided measuring: one engine, two faces (`armd measure` in the terminal, `armd view`'s page).

How a face drives it:

    in_use = get_in_use(connection)                       # armd.connect(…): arm, calibration, tip
    plan = make_plan("artefact", in_use.arm, artefact, Wishes(repeats=2))
    with Measuring(folder, plan, in_use) as measuring:   # begins, or goes on where it was left
        with connection.calling(keys.MEASUREMENT, heard.append):   # new ones only, no history
            while not measuring.complete:
                for payload in heard: told = measuring.offer(json.loads(payload))
                measuring.state(tip_mm)                  # plain dict for JSON: what to show
        measuring.finish()
        for command in list_commands(folder, plan, in_use, EndOptions()):   # `armd calibrate …`, …
            done = run(command)                          # a process of its own; text, exit code

`offer` returns what became of a measurement: `{"event": "reading", …}` or `{"event": "refused",
"reason": …, "text": …}`; `delete_last`, `again` (once more, beyond the plan) and `skip` (cannot be
reached) return the like. What was told is on the disk. `Measuring.resume(folder, in_use)` goes on
without a plan at hand. A measurement that was not taken at the trigger configured is not for
`offer`: with `trigger = "rest"` in armd.toml a rest counts and a press does not.
`Measuring` may be called from any thread; it never waits for a network. `identify_so_far` (seconds,
in a thread of the face's own) tells what `armd calibrate` makes of the readings so far.

    stations     what a plan is: one station per reading; kinds: the plan of each kind; poses: that
                 of `armd design`
    log          what happened, appended and synced; progress: where it stands, a fold over that
    refusal      whether a measurement is the reading asked for; whereabouts: where targets are
    postures     how the arm should stand; coverage: what is covered; estimate: what is known
    following    what follows from where it stands: the next station, and all of the above
    in_use       what the daemon measures with
    measuring    the engine; ending: the commands at the end
"""
