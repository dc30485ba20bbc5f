"""Pools of environments: of this process, and on servers. Both have the same methods.

| module | content |
|---|---|
| `local` | interfaces of pools and their sources, and the pool of this process |
| `preparation` | objects shared by environments, and their preparation |
| `remote` | environments on one server |
| `shard` | environments on one of several servers, and how a lost server is replaced |
| `source` | the request that a client sends to servers, and their answer |
| `spread` | environments on several servers, stepped at once |
"""
