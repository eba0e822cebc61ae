"""Comparisons with some of their members exchanged, as no data give them."""

from dataclasses import fields, replace

OF_CEILING = {"noise_ceiling": "value", "noise_ceiling_interval": "interval"}
OF_CEILING |= {"explainable_gap": "gap"}


def altered(comparison, **members):
    """A comparison with other members, which may be those of its parts."""
    ceiling = {new: members.pop(old) for old, new in OF_CEILING.items() if old in members}
    of_views = {field.name for field in fields(comparison.views)} & members.keys()
    views = {name: members.pop(name) for name in of_views}
    return replace(
        comparison,
        ceiling=replace(comparison.ceiling, **ceiling),
        views=replace(comparison.views, **views),
        **members,
    )
