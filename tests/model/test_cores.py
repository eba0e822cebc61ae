"""Cores answer what the engine asks, whatever their parameters are called."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid.effects import AsymmetricGain, WrongDelay
from skhoid.model.cores import OperatorCore
from skhoid.model.extend import extended
from skhoid.model.fitting import Criterion
from skhoid.model.model import fit_core
from skhoid.model.parameters import parameter_table
from skhoid.testing import synthetic_record

PLAIN = [0.8, 0.3, 9.0, 0.4, 0.2]


class Renamed(OperatorCore):
    """The same core whose parameters have other names."""

    new = {"K_e": "p", "K_edot": "d", "omega_nm": "w", "zeta_nm": "z", "tau_e": "late"}

    def __init__(self, fixed_delay):
        super().__init__(fixed_delay)
        self.parameters = tuple(replace(p, name=self.new[p.name]) for p in self.parameters)
        self.gains, self.delays = ("p", "d"), tuple(self.new[n] for n in self.delays)
        self.ordinary = {self.new[n]: value for n, value in OperatorCore.ordinary.items()}
        ratio = OperatorCore.ratios[0]
        self.ratios = (replace(ratio, over="d", under="p"),)

    def old(self, values):
        back = {new: old for old, new in self.new.items()}
        return {back[n]: value for n, value in values.items() if n in back}

    def delay(self, values):
        return super().delay(self.old(values))

    def command(self, error, gains, values):
        return super().command(error, gains, self.old(values))

    def response(self, command, gains, spring, values, dt):
        return super().response(command, gains, spring, self.old(values), dt)

    def earlier(self, values, seconds):
        return {self.new[n]: v for n, v in super().earlier(self.old(values), seconds).items()}

    def second_order(self, values):
        return super().second_order(self.old(values))


@pytest.mark.parametrize("effect", [AsymmetricGain(), WrongDelay()])
def test_names_of_parameters_change_no_number(effect):
    found = []
    delay = 0.2 if effect.name == "wrong_delay" else None
    for core in (OperatorCore(delay), Renamed(delay)):
        record = synthetic_record()
        start = np.array([PLAIN[: len(core.parameters)]])
        criterion = Criterion(record)
        parent = fit_core(core, record, criterion, start)
        model = extended(parent, effect.name, effect, criterion, criterion.coarse())
        table = parameter_table(
            model.simulator, model.theta, model.covariance(), {}, {}
        ).estimates()
        found.append((model.theta, model.output, table))
    (theta, output, table), (theta_2, output_2, table_2) = found
    np.testing.assert_array_equal(theta, theta_2)
    np.testing.assert_array_equal(output, output_2)
    np.testing.assert_array_equal(table["sd"], table_2["sd"])
    assert list(table.index).index("T_L") == list(table_2.index).index("T_L") == 2
    assert list(table_2.index[:4]) == ["p", "d", "T_L", "w"]
