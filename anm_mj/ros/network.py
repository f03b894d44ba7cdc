"""Which DDS domain and which network the program speaks on, as the environment of ROS 2 says."""

import functools
import os
from collections.abc import Mapping
from typing import Any

from anm_mj.errors import ConfigError

MOST_DOMAINS = 232
"""Domains with a higher number have no ports [DDSI-RTPS 9.6.1.1]."""
_CONFIG = """
<CycloneDDS><Domain>
  {reach}
  <Internal><SocketReceiveBufferSize min="default" max="16MB"/>
    <Watermarks><WhcHigh>32MB</WhcHigh></Watermarks></Internal>
</Domain></CycloneDDS>
"""
"""Buffers have room for a colour and a depth image at once: by default publishers wait for subscribers at half a
megabyte, and what a receiver that is kept waiting has no room for is lost. The system may give less."""
_LOCALHOST = """
  <General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
    <AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers></Discovery>
"""


def domain_id(environment: Mapping[str, str] = os.environ) -> int:
    """The domain's number by ``ROS_DOMAIN_ID``, 0 without it. Raises ConfigError if it is none of a domain."""
    text = environment.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not (text.isdecimal() and int(text) <= MOST_DOMAINS):
        raise ConfigError(f"ROS_DOMAIN_ID is '{text}'; set a whole number from 0 to {MOST_DOMAINS}.")
    return int(text)


def network_config(environment: Mapping[str, str] = os.environ) -> str | None:
    """The configuration of Cyclone DDS that the environment asks for; None = that of ``CYCLONEDDS_URI``. Raises
    ConfigError if ``ROS_AUTOMATIC_DISCOVERY_RANGE`` has a value that is not known.
    """
    reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "SUBNET"
    if reach not in ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"):
        raise ConfigError(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{reach}'; set SUBNET, LOCALHOST or SYSTEM_DEFAULT, or name the "
            "peers in a file of CYCLONEDDS_URI."
        )
    local = environment.get("ROS_LOCALHOST_ONLY", "0") == "1" or reach == "LOCALHOST"
    return None if environment.get("CYCLONEDDS_URI") else _CONFIG.format(reach=_LOCALHOST if local else "")


@functools.cache
def domain(number: int, config: str | None) -> Any:
    """The domain of this process; it can be configured once. Raises ModuleNotFoundError if the package cyclonedds is
    missing, and cyclonedds.core.DDSException if the process uses the domain already, with other peers than those asked
    for.
    """
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain

    if config is None:
        return None
    try:
        return Domain(number, config)
    except DDSException:
        if _LOCALHOST in config:
            raise
        return None  # Without its larger buffers.
