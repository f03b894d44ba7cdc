"""Checkpoints: the state of a run as a file, from which a killed run goes on as if nothing had happened.

A checkpoint holds the object graph of the run as plain data (:mod:`anm_mj.checkpoint.encode`,
:mod:`anm_mj.checkpoint.decode`). To go on, the run is put together from its configuration as at its start, and the
stored state is laid over it. Nothing in a checkpoint is executed: objects are made without their constructors, and only
of the classes that :mod:`anm_mj.checkpoint.known_classes` allows.

New state takes part by itself, because every attribute of every object is stored. A class says what is different:

``REBUILT``
    Names of attributes that a checkpoint leaves out, because the constructor makes them again: models, renderers,
    caches.
``get_state(self)`` and ``set_state(self, state)``
    Further state as plain data, for what lies in attributes that are left out.
"""
