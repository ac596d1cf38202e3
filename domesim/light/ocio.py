"""Spaces of the OpenColorIO configuration in ``$OCIO``: code values <-> linear light in ACES2065-1.

``$OCIO`` is a file, or a configuration that OpenColorIO brings along: ``ocio://cg-config-latest``,
``ocio://studio-config-latest`` or one by its full name. 1.0 of the configuration's reference is the
projector's white. What a space is, OpenColorIO says: its own processors convert, without the
approximations that they make by default. Between its reference and that of displays it takes the
configuration's default view transform, in ACES' own the one without tone mapping.

A space is called by its name and a digest of its conversion, so that another process, perhaps on
another machine, has the same or says that it has not.
"""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError

PREFIX = "ocio:"
_REFERENCE = "ACES2065-1"
_WAY = "a file, or ocio://cg-config-latest or ocio://studio-config-latest"

Floats = NDArray[np.floating]


def called(space: str, option: str) -> str:
    """Returns the tag of a space of the configuration: ``ocio:ACEScct#1a2b3c4d``.

    Parameters
    ----------
    space
        Its name or alias, in any case.
    option
        Where it was asked for.

    Raises
    ------
    InputError
        If OpenColorIO or its configuration is missing, or it has no such space of colours, or none
        that can be converted both ways.
    """
    config = _config(option)
    known = config.getColorSpace(space)
    if known is None or known.isData():
        names = ", ".join(each.getName() for each in config.getColorSpaces() if not each.isData())
        raise InputError(
            f"{option} {PREFIX}{space}: the configuration in $OCIO has no such space of colours; "
            f"use one of: {names}"
        )
    return f"{PREFIX}{known.getName()}#{Space(config, known.getName()).digest}"


def spoken(name: str) -> str:
    """Returns the name that a person reads: ``OCIO 'ACEScct'``."""
    return f"OCIO '{name.removeprefix(PREFIX).rpartition('#')[0]}'"


@lru_cache(maxsize=8)
def space_called(name: str) -> Space:
    """Returns the space that `called` named.

    Raises
    ------
    InputError
        If OpenColorIO is missing, or has another configuration here.
    """
    called_so, _, digest = name.removeprefix(PREFIX).rpartition("#")
    space = Space(_config(spoken(name)), called_so)
    if space.digest != digest:
        raise InputError(
            f"{spoken(name)}: wanted the conversion that the command began with, got another by "
            "$OCIO; set it alike on all machines"
        )
    return space


@final
class Space:
    """One space of a configuration.

    Parameters
    ----------
    config
        OpenColorIO's configuration.
    name
        Name of the space in it.

    Raises
    ------
    InputError
        If there is no way from it to light, or back.

    Attributes
    ----------
    digest
        Digest of what the conversions do.
    """

    def __init__(self, config: Any, name: str) -> None:
        import PyOpenColorIO as ocio  # noqa: N813, PLC0415

        try:
            to = ocio.Config.GetProcessorToBuiltinColorSpace(config, name, _REFERENCE)
            back = ocio.Config.GetProcessorFromBuiltinColorSpace(_REFERENCE, config, name)
            self._to_light, self._to_codes = (
                each.getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS) for each in (to, back)
            )
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            raise InputError(
                f"OCIO '{name}': wanted one that can be converted to {_REFERENCE} and back, got "
                f"'{' '.join(str(error).split())}'. Convert the master first"
            ) from error
        both = self._to_light.getCacheID() + self._to_codes.getCacheID()
        self.digest = hashlib.sha256(both.encode()).hexdigest()[:12]

    def light(self, codes: Floats) -> Floats:
        """(..., RGB) linear light in ACES AP0 of (..., RGB) code values."""
        return _applied(self._to_light, codes)

    def codes(self, light: Floats) -> Floats:
        """(..., RGB) code values of (..., RGB) linear light in ACES AP0."""
        return _applied(self._to_codes, light)


def _applied(processor: Any, values: Floats) -> Floats:
    result = np.array(values, np.float32, order="C")
    processor.applyRGB(result)
    return np.asarray(result, values.dtype)


def _config(what: str) -> Any:
    try:
        import PyOpenColorIO as ocio  # noqa: N813, PLC0415
    except ImportError:
        raise InputError(
            f"{what}: OpenColorIO's spaces need the extra 'ocio': pip install 'domesim[ocio]'"
        ) from None
    place = os.environ.get("OCIO", "")
    if not place:
        raise InputError(f"{what}: no configuration of OpenColorIO; set $OCIO: {_WAY}")
    try:
        config = ocio.Config.CreateFromFile(place)
        config.validate()
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        raise InputError(
            f"{place}: wanted a configuration of OpenColorIO in $OCIO, got "
            f"'{' '.join(str(error).split())}'. Name {_WAY}"
        ) from error
    return config
