"""The tracker: predict, assign, update, birth, death.

Tracker.step does these five steps for the boxes of one frame, for all tracks at a time. The
Kalman filter is in motion.py, and the arrays that describe the tracks are in state.py.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import logit

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, concatenated
from pyinfra.core.boxes import bev_overlap, wrapped
from pyinfra.core.errors import Error
from pyinfra.tracking import motion
from pyinfra.tracking.occlusion import View
from pyinfra.tracking.state import SAME, Boxes, Tracks, shared

# Maximum squared Mahalanobis distance between a track and its box: the 99.9 % quantile of the
# chi-squared distribution with two degrees of freedom.
GATE = 13.8
NEVER = 1e6  # cost of a track and a box outside the gate
SURE = 0.5  # minimum score of boxes that are assigned before all other boxes
SHARED = 0.1  # maximum share of a new track's box that another track's box covers
CLOSE_S = 0.2  # minimum time gap between a vehicle and the vehicle that follows
# Maximum overlap of two moving boxes that are lengthened by the distance driven in CLOSE_S, as a
# share of the smaller area.
CLOSE_SHARE = 0.15
MOVES_M_S = 1.5  # minimum speed of a moving vehicle, whose heading is its direction of motion
FAST_M_S = {"vehicle": 15.0, "person": 2.0}  # standard deviation of a new track's speed ahead
SIDEWAYS_M_S = {"vehicle": 1.5, "person": 2.0}
NOISE_M_S2 = {"vehicle": 1.5, "person": 1.0}  # standard deviation of the acceleration
TURN_PER_S = 0.25  # standard deviation of a vehicle's lateral acceleration, divided by its speed
OUTSIDE_S = 0.5  # time without a box after which a track outside the detector's region ends
# Additional cost of a vehicle's track with a person's box, or the reverse. A motorcycle, for
# example, may be detected as a cyclist.
OTHER_KIND = 6.0
MISSED = 0.5  # decrease of a visible track's log odds in a frame without a box
HEADING_SHARE = 0.2  # weight of a new box in the filtered heading
SIZE_FRAMES = 30  # the size of a track is a mean over about this many boxes
STEPS = 15  # number of time steps whose median is the usual time between frames
SKIPPED = 1.5  # multiple of the usual time between frames above which frames are missing


@dataclass(frozen=True)
class TrackSettings:
    """When tracks begin and end.

    Attributes
    ----------
    min_score : minimum score of a box that is used, 0 to 1
    birth_score : minimum score of a box that may begin a track, 0 to 1
    confirmed : sum of the log odds of a track's scores at which it counts as a track
    missed_s : seconds without a box after which a track in view ends
    hidden_s : the same for a confirmed track that another object hides, or that stands
    gap_s : a gap between frames, in seconds, that ends all tracks
    """

    min_score: float = 0.1
    birth_score: float = 0.3
    confirmed: float = 3.0
    missed_s: float = 1.5
    hidden_s: float = 6.0
    gap_s: float = 10.0

    def __post_init__(self) -> None:
        for name in ("min_score", "birth_score"):
            if not 0 <= getattr(self, name) <= 1:
                raise Error(f"{name}: expected 0 to 1, got {getattr(self, name):g}")
        for name in ("confirmed", "missed_s", "hidden_s", "gap_s"):
            if not 0 < getattr(self, name) < np.inf:
                raise Error(f"{name}: expected a number above 0, got {getattr(self, name):g}")


class Tracker:
    """Turns the boxes of one frame after the other into tracks.

    `tracks` are the tracks after the last frame, including those not yet confirmed. A box is
    x y z dx dy dz heading, in the levelled LiDAR frame, metres and radians.
    """

    def __init__(self, settings: TrackSettings | None = None, view: View | None = None) -> None:
        self.settings = settings or TrackSettings()
        self.view = view or View()
        self.tracks = Tracks.none()
        self.time_s: float | None = None
        self.next_id = 1
        self._steps_s = deque[float](maxlen=STEPS)

    def restart(self) -> None:
        """Ends all tracks, so that the next frame may have any time. Ids continue."""
        self.tracks, self.time_s = Tracks.none(), None
        self._steps_s.clear()

    def step(self, time_s: float, boxes: Boxes) -> Tracks:
        """Processes the boxes of a frame and returns the tracks.

        Raises Error for a time that is not after that of the frame before.
        """
        if self.time_s is not None and not time_s > self.time_s:
            raise Error(f"t_s: expected more than {self.time_s:g}, got {time_s:g}")
        boxes = boxes.merged()
        boxes = boxes.select(boxes.scores >= self.settings.min_score)
        self._predict(time_s)
        track, box = self._assign(boxes)
        self._update(time_s, boxes, track, box)
        self._death(time_s)
        self._birth(time_s, boxes.select(~np.isin(np.arange(len(boxes)), box)))
        return self.tracks

    def _predict(self, time_s: float) -> None:
        """Moves the tracks to a time, without the tracks that end in skipped frames before it."""
        before, self.time_s = self.time_s, time_s
        if before is None:
            return
        if time_s - before > self.settings.gap_s:
            self.tracks = Tracks.none()
            return
        self._steps_s.append(time_s - before)
        step_s = float(np.median(self._steps_s))
        if time_s - before > SKIPPED * step_s:
            self.tracks = self.tracks.select(np.flatnonzero(self._lasting(time_s - step_s)))
        t = self.tracks
        dt_s, across = round(time_s - before, 6), np.clip(TURN_PER_S * t.speed(), 0.1, 1.5)
        along = by_kind(t.person, NOISE_M_S2)
        t.noise = motion.axes(t.heading, along, np.where(t.person, along, across))
        t.state, t.covariance = motion.predict(t.state, t.covariance, dt_s, t.noise)

    def _assign(self, boxes: Boxes) -> tuple[IntArray, IntArray]:
        """Returns indices of tracks and of their boxes; boxes with high scores come first."""
        distance, size = self._distance(boxes)
        size += OTHER_KIND * (self.tracks.person[:, None] != boxes.person)
        cost = np.where(distance < GATE, distance + size, NEVER)
        pairs = [np.empty((0, 2), np.int64)]
        free = np.ones(len(self.tracks), dtype=bool)
        for chosen in (boxes.scores >= SURE, boxes.scores < SURE):
            rows, columns = np.flatnonzero(free), np.flatnonzero(chosen)
            part = cost[np.ix_(rows, columns)]
            i, j = linear_sum_assignment(part)
            within = part[i, j] < NEVER
            pairs.append(np.column_stack([rows[i[within]], columns[j[within]]]))
            free[pairs[-1][:, 0]] = False
        track, box = np.concatenate(pairs).T
        return track, box

    def _distance(self, boxes: Boxes) -> tuple[FloatArray, FloatArray]:
        """Returns squared Mahalanobis distances, and log determinants of their covariances.

        Both are (tracks, boxes). Their sum is twice the negative log likelihood.
        """
        t = self.tracks
        x, y = (boxes.values[None, :, i] - t.state[:, None, i] for i in (0, 1))
        noise = boxes.noise
        xx, xy, yy = (
            t.covariance[:, None, i, j] + noise[None, :, i, j] for i, j in ((0, 0), (0, 1), (1, 1))
        )
        size = xx * yy - xy**2
        return (yy * x**2 - 2 * xy * x * y + xx * y**2) / size, np.log(size)

    def _update(self, time_s: float, boxes: Boxes, track: IntArray, box: IntArray) -> None:
        """Corrects the tracks by their boxes. Tracks without a box count a missed frame."""
        t, b = self.tracks, boxes.select(box)
        # The centre of a box is uncertain if the box is shorter than the track or not wholly in
        # the field of view.
        short = np.maximum(t.size[track, 0] - b.values[:, 3], 0) / 2
        cut = np.where(self.view.cut(b.values), b.values[:, 3] / 2, 0)
        partial = motion.axes(b.values[:, 6], np.maximum(short, cut), 0)
        t.state[track], t.covariance[track] = motion.update(
            t.state[track], t.covariance[track], b.values[:, :2], b.noise + partial
        )
        weight = (1 / np.minimum(t.frames_seen[track] + 1, SIZE_FRAMES))[:, None]
        t.size[track] += weight * (b.values[:, 3:6] - t.size[track])
        t.z[track] += weight[:, 0] * (b.values[:, 2] - t.z[track])
        t.votes[track] += b.votes
        self._turn(track, b)
        t.odds[track] = np.minimum(t.odds[track] + evidence(b.scores), 2 * self.settings.confirmed)
        t.confirmed |= t.odds >= self.settings.confirmed
        t.last_s[track] = time_s
        t.frames_seen[track] += 1
        t.seen[:] = False
        t.seen[track] = True
        missing = np.flatnonzero(~t.seen)
        t.frames_missed[missing] += 1
        t.hidden[:] = False
        t.hidden[missing] = self.view.hidden(t.boxes()[missing], t.boxes()[t.seen])
        t.odds[missing] -= np.where(t.hidden[missing], 0, MISSED)

    def _turn(self, track: IntArray, boxes: Boxes) -> None:
        """Filters headings modulo half a turn. Boxes and motion decide which end is the front."""
        t = self.tracks
        off = wrapped(boxes.values[:, 6] - t.heading[track])
        flipped = np.abs(off) > np.pi / 2
        t.heading[track] += HEADING_SHARE * np.where(flipped, wrapped(off + np.pi), off)
        course = np.arctan2(t.state[track, 3], t.state[track, 2])
        agrees = np.cos(course - t.heading[track])
        fast = t.speed()[track] > MOVES_M_S
        # Boxes and motion decide whether the heading is kept or reversed. Motion has more weight.
        t.ahead[track] += np.where(flipped, -1, 1) * boxes.scores + np.where(fast, 3 * agrees, 0)
        t.ahead[track] = np.clip(t.ahead[track], -20, 20)
        back = track[t.ahead[track] < 0]
        t.heading[back] += np.pi
        t.ahead[back] *= -1
        t.heading[track] = wrapped(t.heading[track])

    def _birth(self, time_s: float, boxes: Boxes) -> None:
        """Begins a track at each box with a score of birth_score or more that no track covers."""
        boxes = boxes.select(boxes.scores >= self.settings.birth_score)
        boxes = boxes.select(~covered(boxes.values, self.tracks.boxes()))
        fast = by_kind(boxes.person, FAST_M_S)
        count = len(boxes)
        state = np.zeros((count, motion.STATES))
        state[:, :2] = boxes.values[:, :2]
        covariance = np.zeros((count, motion.STATES, motion.STATES))
        covariance[:, :2, :2] = boxes.noise
        covariance[:, 2:4, 2:4] = motion.axes(
            boxes.values[:, 6], fast, by_kind(boxes.person, SIDEWAYS_M_S)
        )
        covariance[:, 4:, 4:] = np.eye(2) * by_kind(boxes.person, NOISE_M_S2)[:, None, None] ** 2
        new = Tracks.begin(self.next_id, time_s, boxes, state, covariance)
        new.odds[:] = evidence(boxes.scores)
        new.confirmed[:] = new.odds >= self.settings.confirmed
        self.next_id += count
        self.tracks = concatenated([self.tracks, new])

    def _death(self, time_s: float) -> None:
        """Ends tracks without a recent box, tracks with low odds, and second tracks of one
        object."""
        t = self.tracks
        doubtful = t.odds < np.where(t.confirmed, -self.settings.confirmed, -1)
        self.tracks = t = t.select(np.flatnonzero(~doubtful & self._lasting(time_s)))
        self.tracks = t.select(np.flatnonzero(~doubled(t)))

    def _lasting(self, time_s: float) -> BoolArray:
        """Returns which tracks have a last box that is recent enough at a time."""
        t, settings = self.tracks, self.settings
        patient = t.confirmed & (t.hidden | (t.speed() < MOVES_M_S))
        allowed_s = np.where(patient, settings.hidden_s, settings.missed_s)
        allowed_s[self.view.outside(t.boxes())] = OUTSIDE_S
        return np.asarray(time_s - t.last_s <= allowed_s)


def evidence(scores: FloatArray) -> FloatArray:
    """Returns the log odds of calibrated scores, clipped so that a single box adds little."""
    return np.asarray(np.clip(logit(np.clip(scores, 0.01, 0.99)), -1.5, 1.5))


def by_kind(person: BoolArray, values: dict[str, float]) -> FloatArray:
    """Returns the value of each track: that of persons or of vehicles."""
    return np.where(person, values["person"], values["vehicle"])


def covered(boxes: FloatArray, others: FloatArray) -> BoolArray:
    """Returns which boxes (n, 7) share much of their area with one of the others (m, 7)."""
    shared = bev_overlap(boxes, others) / np.maximum(boxes[:, 3] * boxes[:, 4], 1e-6)[:, None]
    return np.asarray((shared > SHARED).any(axis=1))


def doubled(t: Tracks) -> BoolArray:
    """Returns which tracks follow an object that another, more often seen track follows too.

    Such a track lies mostly in the other's box, or it drives closer to the other than drivers do.
    The cause is that detectors return separate boxes at the ends of buses.
    """
    longer = t.boxes()
    longer[:, 3] += CLOSE_S * t.speed()
    pairs, share = shared(longer)
    moves = (t.speed()[pairs] > MOVES_M_S).all(axis=1)
    pairs = pairs[share > np.where(moves, CLOSE_SHARE, SAME)]
    seen = t.frames_seen[pairs]
    out = np.zeros(len(t), dtype=bool)
    out[pairs[np.arange(len(pairs)), np.where(seen[:, 0] < seen[:, 1], 0, 1)]] = True
    return out
