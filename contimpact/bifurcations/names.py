"""Names of the kinds of events, for whoever only has to read or to list them."""

KINDS = ("FB", "BP", "PD", "NS", "G", "V", "T", "UZ")
"""Every kind that is looked for along branches."""

EVENTS = ("FB", "BP", "PD", "G", "V", "T")
"""Those looked for where nothing else is said."""

LABELLED = ("FB", "BP", "PD", "NS", "G", "V", "T")
"""Those that can be ghosts by name; requested values and users' events are not marked."""

SWITCHES = ("G", "V", "PD", "BP")
"""Those at which other branches are born."""

CURVES = ("FB", "BP", "PD", "G", "V")
"""Those that have curves in two parameters."""
