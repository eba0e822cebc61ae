"""Recursive prediction errors and instruments beside autoregressive noise, written plainly.

Signals are lists since the last rest, zero before it; nothing is shifted, factored or reused.
"""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

STILL, ORDINARY, LARGE = 3e-6, 4.0, 9.0


@dataclass
class Setting:
    """Orders, the rows to wait after a rest and after a NaN, and shares of what follows."""

    na: int
    nb: list
    nk: list
    nd: int
    waits: tuple
    lam: np.ndarray  # of each parameter
    lam_noise: float
    share_filter: float
    share_variance: float


class Signal(list):
    """Values from row 0 on; zero before."""

    def __getitem__(self, t):
        return super().__getitem__(t) if t >= 0 else 0.0


class Lane:
    """What is known of a run since its last rest."""

    def __init__(self):
        self.signals = defaultdict(Signal)
        self.row = -1
        self.last_nan = None

    def __getitem__(self, name):
        return self.signals[name]


class Noise:
    """Textbook recursive least squares of v on what came before it."""

    def __init__(self, d, P, variance, setting):
        self.d, self.P, self.variance, self.setting = d.copy(), P.copy(), variance, setting

    def polynomial(self, signal, t):
        """D(q) s at t."""
        return signal[t] + sum(d * signal[t - 1 - j] for j, d in enumerate(self.d))

    def follow(self, v):
        error = v[0] + self.d @ v[1:]
        weight = 1.0 / max(1.0, error**2 / (ORDINARY * self.variance))
        x = -v[1:]
        P = self.P / self.setting.lam_noise
        gain = P @ x / (1.0 / weight + x @ P @ x)
        self.d = self.d + gain * error
        self.P = P - np.outer(gain, x @ P)
        step = min(error**2, LARGE * self.variance) - self.variance
        self.variance += self.setting.share_variance * step


class Twin:
    """What both recursions share: theta, the F of filters that lags behind, and the noise."""

    def __init__(self, setting, theta, noise, largest, n_runs=1):
        self.setting, self.theta, self.noise = setting, theta.copy(), noise
        self.slow = theta[: setting.na].copy()
        self.largest = largest.copy()
        self.lanes = [Lane() for _ in range(n_runs)]
        self.n_updates, self.squares, self.n_held = 0, 0.0, 0

    def rest(self, run):
        self.lanes[run] = Lane()

    def filtered(self, signal, value):
        """Append value / F, by the F of the filters, to a signal."""
        signal.append(value - sum(f * signal[len(signal) - 1 - k] for k, f in enumerate(self.slow)))

    def take_inputs(self, lane, inputs):
        """Append inputs, a NaN holding the value before, and inputs / F; whether any was NaN."""
        broken = False
        for i, value in enumerate(inputs):
            if not np.isfinite(value):
                broken, value = True, lane["e", i][lane.row - 1]
            lane["e", i].append(value)
            self.filtered(lane["e/F", i], lane["e", i][lane.row - self.setting.nk[i]])
        return broken

    def usable(self, lane, y, broken):
        if broken:
            lane.last_nan = lane.row
        waits = self.setting.waits
        long_enough = lane.last_nan is None or lane.row - lane.last_nan >= waits[1]
        return np.isfinite(y) and lane.row >= waits[0] and long_enough

    def excited(self, regressors):
        size = np.abs(regressors)
        found = bool((size > STILL * self.largest).any())
        self.largest = np.maximum(self.largest, size)
        return found

    def follow_filters(self):
        self.slow = self.slow + self.setting.share_filter * (
            self.theta[: self.slow.size] - self.slow
        )

    def follow_noise(self, lane):
        """v = (F u - B e) / F now and nd rows before, by the newest theta."""
        na, nd = self.setting.na, self.setting.nd
        if nd == 0:
            return
        v = []
        for i in range(nd + 1):
            t = lane.row - i
            value = lane["u/F"][t]
            value += sum(f * lane["u/F"][t - 1 - k] for k, f in enumerate(self.theta[:na]))
            p = na
            for j, nb in enumerate(self.setting.nb):
                value -= sum(self.theta[p + k] * lane["e/F", j][t - k] for k in range(nb))
                p += nb
            v.append(value)
        self.noise.follow(np.array(v))

    def updated(self, used):
        """Update, and give the errors of runs that took part: the last entry of each in used."""
        self.update(used)
        errors = np.full(len(self.lanes), np.nan)
        for run, *_, error in used:
            errors[run] = error
        return errors


def inside(f):
    return np.abs(np.roots(np.r_[1.0, f])).max(initial=0.0) < 1.0


def regular(R, least):
    """Whether each pivot is more than a share of its diagonal element."""
    try:
        return bool((np.diag(np.linalg.cholesky(R)) ** 2 > least * np.diag(R)).all())
    except np.linalg.LinAlgError:
        return False


class PredictionErrors(Twin):
    """eps = D u - B/F (D e), psi = D/F [-w ... e ...], theta += R^-1 psi eps."""

    def __init__(self, setting, theta, noise, largest, information, n_runs=1):
        super().__init__(setting, theta, noise, largest, n_runs)
        self.R = information.copy()

    def instant(self, inputs, outputs):
        """inputs of shape (n_inputs, n_runs), outputs (n_runs,); returns errors of updates."""
        setting, noise = self.setting, self.noise
        na, used = setting.na, []
        for run, lane in enumerate(self.lanes):
            lane.row += 1
            t = lane.row
            broken = self.take_inputs(lane, inputs[:, run])
            regressors = [-lane["Dw"][t - 1 - k] for k in range(na)]
            psi = [-lane["Dw/F"][t - 1 - k] for k in range(na)]
            for i, (nb, nk) in enumerate(zip(setting.nb, setting.nk, strict=True)):
                regressors += [noise.polynomial(lane["e", i], t - nk - k) for k in range(nb)]
                psi += [noise.polynomial(lane["e/F", i], t - k) for k in range(nb)]
            simulated = float(np.dot(self.theta, regressors))
            before = sum(d * lane["u"][t - 1 - k] for k, d in enumerate(noise.d))
            y = outputs[run]
            usable = self.usable(lane, y, broken)
            if not np.isfinite(y):
                y = simulated - before
            if usable and self.excited(np.array(psi)):
                used.append((run, np.array(psi), y + before - simulated))
            lane["Dw"].append(simulated)
            self.filtered(lane["Dw/F"], simulated)
            lane["u"].append(y)
            self.filtered(lane["u/F"], y)
        return self.updated(used)

    def update(self, used):
        if not used:
            self.n_held += 1
            return
        Lambda = np.diag(np.sqrt(self.setting.lam))
        self.R = Lambda @ self.R @ Lambda + sum(np.outer(psi, psi) for _, psi, _ in used)
        self.n_updates += len(used)
        self.squares += sum(error**2 for *_, error in used)
        if regular(self.R, 1e-14):
            step = np.linalg.solve(self.R, sum(psi * error for _, psi, error in used))
            for _ in range(10):
                if inside((self.theta + step)[: self.setting.na]):
                    self.theta = self.theta + step
                    self.follow_filters()
                    break
                step = step / 2
        for run, *_ in used:
            self.follow_noise(self.lanes[run])


class Instruments(Twin):
    """theta = (S_zp' S_zz^-1 S_zp)^-1 S_zp' S_zz^-1 S_zu of signals filtered by D / F."""

    def __init__(self, setting, theta, noise, largest, lags, n_external, n_runs=1):
        super().__init__(setting, theta, noise, largest, n_runs)
        self.lags, n = lags, theta.size
        nz = len(lags) * n_external
        self.ZZ, self.ZP, self.ZU = np.zeros((nz, nz)), np.zeros((nz, n)), np.zeros(nz)
        self.R = np.zeros((n, n))
        self.frozen = False

    def instant(self, signals, outputs):
        """signals are inputs, then external ones."""
        setting, noise = self.setting, self.noise
        n_inputs, used = len(setting.nb), []
        for run, lane in enumerate(self.lanes):
            lane.row += 1
            t = lane.row
            phi = [-noise.polynomial(lane["u/F"], t - 1 - k) for k in range(setting.na)]
            broken = self.take_inputs(lane, signals[:n_inputs, run])
            for i, nb in enumerate(setting.nb):
                phi += [noise.polynomial(lane["e/F", i], t - k) for k in range(nb)]
            phi, z = np.array(phi), []
            for i, value in enumerate(signals[n_inputs:, run]):
                broken |= not np.isfinite(value)
                self.filtered(lane["x/F", i], value if np.isfinite(value) else 0.0)
                lane["Dx/F", i].append(noise.polynomial(lane["x/F", i], t))
                z += [lane["Dx/F", i][t - lag] for lag in self.lags]
            y, before = outputs[run], 0.0
            before = sum(d * lane["u/F"][t - 1 - j] for j, d in enumerate(noise.d))
            usable = self.usable(lane, y, broken)
            if np.isfinite(y):
                self.filtered(lane["u/F"], y)
            else:
                lane["u/F"].append(self.theta @ phi - before)
            whitened = lane["u/F"][t] + before
            if usable and self.excited(phi):
                used.append((run, phi, np.array(z), whitened, whitened - self.theta @ phi))
        return self.updated(used)

    def update(self, used):
        if not used:
            self.n_held += 1
            return
        lam = 1.0 if self.frozen else self.setting.lam[0]
        self.ZZ = lam * self.ZZ + sum(np.outer(z, z) for _, _, z, _, _ in used)
        self.ZP = lam * self.ZP + sum(np.outer(z, phi) for _, phi, z, _, _ in used)
        self.ZU = lam * self.ZU + sum(z * u for _, _, z, u, _ in used)
        self.n_updates += len(used)
        self.squares += sum(error**2 for *_, error in used)
        if self.frozen:
            return
        weights = np.linalg.solve(self.ZZ, self.ZP).T
        self.R = weights @ self.ZP
        if regular(self.R, 1e-13):
            theta = np.linalg.solve(self.R, weights @ self.ZU)
            if inside(theta[: self.setting.na]):
                self.theta = theta
                self.follow_filters()
        for run, *_ in used:
            self.follow_noise(self.lanes[run])
