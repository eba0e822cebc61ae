"""Sphinx extension: the catalogue's grid, and a card for each effect, made from the effects.

``effect-grid`` shows all effects of a place, each a link to its page; ``effect-card`` opens that
page, which autosummary makes by ``_templates/autosummary/effect.rst``. To change what a
card says, change the effect; to change how, ``_templates/effect_card.rst``.
"""
