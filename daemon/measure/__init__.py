"""Guided measuring: one engine, two faces (`armd measure` in the terminal, `armd view`'s page).

A face uses it like this:

    in_use = get_in_use(connection)                       # armd.connect(…): arm, calibration, tip
    plan = make_plan("artefact", in_use.arm, artefact, Wishes(repeats=2))
    with Measuring(folder, plan, in_use) as measuring:   # begins, or continues where it stopped
        with connection.calling(keys.MEASUREMENT, heard.append):   # new ones only, no history
            while not measuring.complete:
                for payload in heard: told = measuring.offer(json.loads(payload))
                measuring.state(tip_mm)                  # plain dict for JSON: what to show
        measuring.finish()
        for command in list_commands(folder, plan, in_use, EndOptions()):   # `armd calibrate …`, …
            done = run(command)                          # a separate process; text, exit code

`offer` returns the outcome of a measurement: `{"event": "reading", …}` or `{"event": "refused",
"reason": …, "text": …}`. `delete_last`, `again` (repeats beyond the plan) and `skip` (cannot be
reached) return similar data. A reported outcome is on the disk. `Measuring.resume(folder, in_use)`
continues without a plan at hand. A face must not `offer` a measurement with another trigger than
the configured one: with `trigger = "rest"` in armd.toml a rest counts and a press does not.
`Measuring` may be called from any thread; it never waits for a network. `identify_so_far` takes
seconds, in a thread of the face's own; it gives the result of `armd calibrate` for the readings so
far.

    plan         kinds: the plan of each kind; stations: one station per reading; poses: the plan
                 from `armd design`; postures: how the arm should stand
    log          entries, appended and synced
    so_far       progress: the state, a fold over the log; whereabouts: positions of targets;
                 coverage: what is covered; estimate: what is known; following: the next station
    refusal      whether a measurement is the requested reading
    in_use       the daemon's arm, calibration and tip
    measuring    the engine
    ending       the commands at the end
"""
