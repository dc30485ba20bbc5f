"""Helpers below all other modules.

| module | content |
|---|---|
| `arguments` | checks of arguments: numbers, arrays, names, settings |
| `by_value` | equality of data classes that hold arrays |
| `files` | atomic writes, reads with a size limit, folders locked by their writer |
| `progress` | a progress bar, and formatted times |
| `refusals` | objects that are left out of a run, with the reason |
| `rotations` | conversion of rotations to and from quaternions and Euler angles |
| `schemas` | JSON documents checked by pydantic |
"""
