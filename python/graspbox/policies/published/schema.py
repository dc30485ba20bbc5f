"""Validation of ``config.json`` by pydantic (extra ``onnx``): all fields are required and typed, extra ones rejected.

Only a field whose default is None may be absent.

The schema follows from the annotations of `graspbox.policies.published.configs.PolicyConfig` and its subclasses. The
data classes check ranges themselves, on every construction.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from typing import Any, Literal, TypeVar, cast, get_type_hints

from graspbox._common.arguments import plain, shown
from graspbox._common.imports import imported
from graspbox.errors import ConfigError
from graspbox.policies.published.configs import PolicyConfig
from graspbox.policies.published.registry import config_class

__all__ = ["FORMAT", "content_of", "parse"]

#: Version of the format.
FORMAT = 2
_ENVELOPE = tuple(f.name for f in fields(PolicyConfig))
_LONGEST_TEXT = 4096

Config = TypeVar("Config", bound=PolicyConfig)


def content_of(config: PolicyConfig) -> dict[str, Any]:
    """Arrange a configuration in the layout of ``config.json``."""
    values: dict[str, Any] = plain(config, type(config).__name__)
    envelope = {name: values.pop(name) for name in _ENVELOPE}
    return {"format": FORMAT, "kind": config.kind, **envelope, config.kind: values}


def parse(text: bytes, name: str) -> PolicyConfig:
    """Parse ``config.json``, named `name` in errors.

    Raises ConfigError if it is not JSON, has another format, or a field is missing, unknown or wrong.
    """
    pydantic = _pydantic()
    try:
        content = import_module("pydantic_core").from_json(text, allow_inf_nan=False)
    except ValueError as error:
        raise ConfigError(f"{name} is not valid JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        version = shown(content["format"]) if isinstance(content, dict) and "format" in content else "missing"
        raise ConfigError(
            f"{name}: format is {version}, this version of graspbox reads {FORMAT}; the policy was made with another "
            "version: export it again"
        )
    try:
        for entry, value in content.items():
            plain(value, entry)
        config = config_class(content.get("kind"))
        made = _model(cast(Any, config)).model_validate_json(text)
    except pydantic.ValidationError as error:
        raise ConfigError(f"{name}: {_sentence(error.errors()[0], content, config)}") from None
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None
    section = getattr(made, config.kind)
    envelope = {n: getattr(made, n) for n in _ENVELOPE}
    own = {n: getattr(section, n) for n in type(section).model_fields}
    try:
        optional = {f.name for f in fields(config) if f.default is None}
        present = {name: value for name, value in own.items() if name not in optional or name in content[config.kind]}
        _check_complete({**envelope, config.kind: present}, content, "")
        return config(**envelope, **own)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def _pydantic() -> Any:
    return imported("pydantic", "folders of policies need the package pydantic", "onnx")


@cache
def _model(config: Any) -> Any:
    """Build the schema of a kind; only fields whose default is None may be absent, and values are not converted."""
    pydantic, hints = _pydantic(), get_type_hints(config)
    strict = pydantic.ConfigDict(
        strict=True, extra="forbid", allow_inf_nan=False, str_min_length=1, str_max_length=_LONGEST_TEXT
    )

    def model(**types: Any) -> Any:
        return pydantic.create_model("Config", __config__=strict, **types)

    own = [f for f in fields(config) if f.name not in _ENVELOPE]
    section = model(**{f.name: (hints[f.name], None if f.default is None else ...) for f in own})
    envelope = {name: (hints[name], ...) for name in _ENVELOPE}
    head = {"format": (Literal[FORMAT], ...), "kind": (Literal[config.kind], ...)}
    return model(**head, **envelope, **{config.kind: (section, ...)})


def _check_complete(made: Any, document: Any, where: str) -> None:
    """Refuse data classes with defaults filled in: only a field whose default is None may be absent."""
    optional: set[str] = set()
    if is_dataclass(made) and not isinstance(made, type):
        optional = {f.name for f in fields(made) if f.default is None}
        made = {f.name: getattr(made, f.name) for f in fields(made)}
    if isinstance(made, Mapping):
        for name, value in made.items():
            if name not in document and name in optional:
                continue
            if name not in document:
                raise ConfigError(f"{where}{name} is missing; export the policy again")
            _check_complete(value, document[name], f"{where}{name}.")
    elif isinstance(made, tuple) and isinstance(document, list):
        for i, value in enumerate(made):
            _check_complete(value, document[i], f"{where}{i}.")


def _sentence(error: Mapping[str, Any], content: Mapping[str, Any], config: type[PolicyConfig]) -> str:
    """Describe an error in one sentence: field, value, and remedy."""
    place, kind = ".".join(map(str, error["loc"])), error["type"]
    if kind == "missing":
        return f"{place} is missing; export the policy again"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        near = get_close_matches(str(error["loc"][-1]), _names(config), n=1)
        return f"there is no field {place}; {f'did you mean {near[0]!r}?' if near else 'remove it'}"
    if kind == "value_error":
        return f"{place}.{error['ctx']['error']}"
    message = error["msg"].replace("Input should be", "it must be").replace("String should have", "it must have")
    return f"{place} is {shown(error['input'])}; {message}"


def _names(kind: Any) -> set[str]:
    """List the names of the fields of a data class and of nested ones."""
    hints = get_type_hints(kind)
    names: set[str] = set()
    for f in fields(kind):
        inner = [t for t in (hints[f.name], *getattr(hints[f.name], "__args__", ())) if is_dataclass(t)]
        names |= {f.name}.union(*(_names(t) for t in inner))
    return names
