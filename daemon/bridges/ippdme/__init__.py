"""An I++ DME server in manual mode, for inspection software (docs/how-to/ippdme.md).

`grammar`, `errors`, `csy` and `tools` follow the standard. `commands*` hold the methods by name.
`dialogue` is one client's dialogue, without network or clock. `machine` presents the arm as a
measuring machine. `server` connects them.
"""
