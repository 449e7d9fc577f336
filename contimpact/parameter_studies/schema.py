"""The schema of a store, as the steps by which it has grown.

A new store takes all steps, an older one those it lacks. Steps are never changed; what has to
become different is a further step. ``PRAGMA user_version`` says how many a store has taken.

Rows are known by the study's number, the scene's number in it and a name or number in the scene,
never by the order in which they came: the same study gives the same rows, however often it was
interrupted.
"""

from __future__ import annotations

APPLICATION = 0x636F6E74
"""``PRAGMA application_id`` of a store: "cont"."""

STEPS = (
    """
    CREATE TABLE versions (
        version INTEGER PRIMARY KEY,
        record  TEXT NOT NULL UNIQUE         -- of the package and its libraries, as JSON
    );
    CREATE TABLE studies (
        study      INTEGER PRIMARY KEY,
        name       TEXT NOT NULL UNIQUE,
        source     TEXT NOT NULL,
        digest     TEXT NOT NULL,            -- of all that decides what is computed
        record     TEXT NOT NULL,            -- the study file, as JSON
        keep       TEXT NOT NULL,            -- what is kept, names in a row
        axes       TEXT NOT NULL,            -- parameters that differ, names in a row
        parameter  TEXT NOT NULL,            -- followed
        derived    TEXT,                     -- the first derived parameter, if there is one
        scenes     INTEGER NOT NULL          -- how many there are to compute
    );
    CREATE TABLE runs (                      -- one for each time a study was started or resumed
        study     INTEGER NOT NULL REFERENCES studies,
        began     TEXT NOT NULL,             -- UTC
        executor  TEXT NOT NULL,
        workers   INTEGER,
        scenes    INTEGER NOT NULL,          -- to compute
        estimate  REAL,                      -- s, made after the first few of them
        seconds   REAL,                      -- it has taken; NULL if it did not end by itself
        done      INTEGER
    );
    CREATE TABLE scenes (                    -- that are finished
        study       INTEGER NOT NULL REFERENCES studies,
        scene       INTEGER NOT NULL,
        status      TEXT NOT NULL,           -- done, incomplete or failed
        version     INTEGER NOT NULL REFERENCES versions,
        seconds     REAL,                    -- NULL if its worker ended
        points      INTEGER,                 -- of its branches
        evaluations INTEGER,                 -- of flights
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    CREATE TABLE coordinates (               -- of scenes, in the study's axes
        study INTEGER NOT NULL,
        scene INTEGER NOT NULL,
        name  TEXT NOT NULL,
        value REAL NOT NULL,
        PRIMARY KEY (study, scene, name)
    ) WITHOUT ROWID;
    CREATE TABLE failures (
        study  INTEGER NOT NULL,
        scene  INTEGER NOT NULL,
        kind   TEXT NOT NULL,                -- refused, numerical, budget, worker or error
        reason TEXT NOT NULL,
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    CREATE TABLE branches (
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        branch    TEXT NOT NULL,
        notation  TEXT NOT NULL,
        word      TEXT NOT NULL,
        period    INTEGER NOT NULL,
        origin    TEXT,                      -- the event it was born at
        points    INTEGER NOT NULL,
        low       REAL NOT NULL,             -- of the followed parameter
        high      REAL NOT NULL,
        first_end TEXT NOT NULL,
        last_end  TEXT NOT NULL,
        missed    INTEGER NOT NULL,          -- events that could not be located
        content   BLOB,                      -- the branch's table, where it is kept
        PRIMARY KEY (study, scene, branch)
    ) WITHOUT ROWID;
    CREATE TABLE events (
        study       INTEGER NOT NULL,
        scene       INTEGER NOT NULL,
        event       TEXT NOT NULL,
        branch      TEXT NOT NULL,
        kind        TEXT NOT NULL,
        label       TEXT NOT NULL,
        ghost       INTEGER NOT NULL,
        notation    TEXT NOT NULL,
        word        TEXT NOT NULL,
        period      INTEGER NOT NULL,
        becomes     TEXT,
        wall        TEXT,
        value       REAL NOT NULL,           -- of the followed parameter
        derived     REAL,                    -- of the study's derived one
        stable      INTEGER NOT NULL,
        physical    INTEGER NOT NULL,
        n_unstable  INTEGER NOT NULL,
        criticality TEXT,
        why         TEXT,
        arclength   REAL NOT NULL,
        residual    REAL NOT NULL,
        error       REAL NOT NULL,
        PRIMARY KEY (study, scene, event)
    ) WITHOUT ROWID;
    CREATE INDEX events_by_label ON events (study, label, ghost);
    CREATE TABLE intervals (                 -- of stable physical orbits
        study        INTEGER NOT NULL,
        scene        INTEGER NOT NULL,
        number       INTEGER NOT NULL,
        branch       TEXT NOT NULL,
        notation     TEXT NOT NULL,
        low          REAL NOT NULL,
        high         REAL NOT NULL,
        low_end      TEXT,                   -- the event's name, or why the branch ends
        high_end     TEXT,
        low_derived  REAL,
        high_derived REAL,
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE transitions (               -- from an orbit to one with one impact more
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        number    INTEGER NOT NULL,
        source    TEXT NOT NULL,
        target    TEXT NOT NULL,
        mechanism INTEGER,
        grazing   TEXT NOT NULL,             -- the event
        doubling  TEXT,
        fold      TEXT,
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE attractors (
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        number    INTEGER NOT NULL,
        direction TEXT NOT NULL,
        value     REAL NOT NULL,
        kind      TEXT NOT NULL,
        notation  TEXT NOT NULL,
        word      TEXT,
        period    INTEGER,
        exponent  REAL,                      -- the larger Lyapunov exponent per impact
        rate      REAL,                      -- impacts per forcing period
        gap       REAL,                      -- the smallest
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE energies (                  -- of the attractors
        study      INTEGER NOT NULL,
        scene      INTEGER NOT NULL,
        number     INTEGER NOT NULL,
        per_impact REAL NOT NULL,            -- V
        per_time   REAL NOT NULL,            -- V per unit of dimensionless time
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE curves (                    -- of bifurcations in two parameters
        study    INTEGER NOT NULL,
        scene    INTEGER NOT NULL,
        curve    TEXT NOT NULL,
        kind     TEXT NOT NULL,
        label    TEXT NOT NULL,
        notation TEXT NOT NULL,
        first    TEXT NOT NULL,              -- the two parameters
        second   TEXT NOT NULL,
        points   INTEGER NOT NULL,
        content  BLOB NOT NULL,              -- its table
        PRIMARY KEY (study, scene, curve)
    ) WITHOUT ROWID;
    CREATE TABLE catalogues (                -- whole, where they are kept
        study   INTEGER NOT NULL,
        scene   INTEGER NOT NULL,
        content BLOB NOT NULL,
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    """,
    """
    CREATE TABLE codimension_two (           -- points on the curves
        study        INTEGER NOT NULL,
        scene        INTEGER NOT NULL,
        number       INTEGER NOT NULL,
        curve        TEXT NOT NULL,
        kind         TEXT NOT NULL,
        notation     TEXT NOT NULL,
        first        TEXT NOT NULL,          -- the two parameters
        second       TEXT NOT NULL,
        first_value  REAL NOT NULL,
        second_value REAL NOT NULL,
        derived      REAL,
        residual     REAL NOT NULL,
        error        REAL NOT NULL,          -- of the second parameter
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    """,
    """
    CREATE TABLE limits (                    -- of the scene, that cut something off
        study    INTEGER NOT NULL,
        scene    INTEGER NOT NULL,
        number   INTEGER NOT NULL,
        key      TEXT NOT NULL,              -- of the scene, such as follow.max_branches
        value    INTEGER NOT NULL,
        what     TEXT NOT NULL,              -- was left out
        left_out INTEGER NOT NULL,           -- how many
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    """,
)

OF_SCENES = (
    "coordinates",
    "failures",
    "limits",
    "branches",
    "events",
    "intervals",
    "transitions",
    "attractors",
    "energies",
    "curves",
    "codimension_two",
    "catalogues",
)
"""The tables with rows of a scene, besides that of the scenes."""
TABLES = ("versions", "studies", "runs", "scenes", *OF_SCENES)
