"""Lenses: calibrations that people published, where OpenCV's own projection puts rays, and views of a board."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np

from ledpi.core.records import DistortionModel, Floats, Intrinsics
from ledpi.workshop.calibrate.boards import Board, BoardView

BOARD = Board(columns=8, rows=6)


def opencv_pixels(rays_xy: Floats, lens: Intrinsics) -> Floats:
    """(N, 2) pixels of rays (x/z, y/z) (N, 2), by cv2.projectPoints or cv2.fisheye."""
    coefficients = np.array(lens.distortion)
    if lens.distortion_model == "equidistant":
        seen = cv2.fisheye.distortPoints(rays_xy.reshape(1, -1, 2), lens.matrix(), coefficients)
    else:
        points = np.column_stack([rays_xy, np.ones(len(rays_xy))])
        seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix(), coefficients)[0]
    return np.asarray(seen, np.float64).reshape(-1, 2)


def views_of(lens: Intrinsics, count: int, widest_deg: float, noise_px: float = 0.1) -> list[BoardView]:
    """A board held in all directions, tilted; its corners by OpenCV's projection, those in the picture."""
    rng, views = np.random.default_rng(8), []
    corners = BOARD.corners() - BOARD.corners().mean(axis=0)
    while len(views) < count:
        aside, around = math.radians(widest_deg) * math.sqrt(rng.uniform()), rng.uniform(0, 2 * math.pi)
        to = cv2.Rodrigues(np.array([-math.sin(around), math.cos(around), 0.0]) * aside)[0]
        tilt = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3))[0]
        points = (corners @ tilt.T + (0, 0, rng.uniform(8, 14))) @ to.T
        seen = opencv_pixels(points[:, :2] / points[:, 2:], lens)
        inside = (points[:, 2] > 0) & (seen > 2).all(axis=1) & (seen < (lens.width - 3, lens.height - 3)).all(axis=1)
        if inside.sum() >= 20:
            ids = np.flatnonzero(inside)
            places = seen[ids] + rng.normal(0, noise_px, (len(ids), 2))
            views.append(BoardView(name=f"{len(views):02}", corner_ids=ids, corners_px=places))
    return views


def _lens(
    size: tuple[int, int],
    focal: tuple[float, float],
    centre: tuple[float, float],
    *distortion: float,
    model: DistortionModel = "plumb_bob",
) -> Intrinsics:
    return Intrinsics(
        width=size[0],
        height=size[1],
        fx=focal[0],
        fy=focal[1],
        cx=centre[0],
        cy=centre[1],
        distortion=distortion if model != "plumb_bob" else (*distortion, 0.0)[:5],
        distortion_model=model,
    )


_VGA, _HD = (640, 480), (1280, 720)
# fmt: off
PUBLIC: Mapping[str, Intrinsics] = {
    "Pi camera 2, ROS": _lens(
        _VGA, (724.7065317897147, 723.9111589306867), (329.1544084760975, 222.2659871640654),
        -0.425024653765871, 0.2275022820178016, -0.0009324566898835676, 0.002125165132523941,
    ),
    "Pi camera 2, HD, ROS": _lens(
        _HD, (1280.628466572832, 1277.989132765768), (658.384219880362, 360.8363923435625),
        0.2032697817127332, -0.4147569733010375, -0.001420915782245743, 0.003110652248245379,
    ),
    "Pi camera 3, 320 x 240, ROS": _lens(
        (320, 240), (167.24709, 168.39658), (141.74334, 116.78567), -0.270722, 0.052308, -0.000257, 0.002980,
    ),
    "webcam, ROS": _lens(_VGA, (580.46715, 576.62721), (315.27153, 247.47257), 0.134462, -0.311908, 0.002304, 0.003083),
    "webcam, HD, OpenCV": _lens(
        _HD, (971.3522049722402, 970.0199397879108), (646.7224920082377, 357.74170661497186),
        -0.036721326921445439, 0.60501514643400323, 0.0027156799005218536, 0.004020840488251875, -1.8414740894267736,
    ),
    "PointGrey, 800 x 600, ROS": _lens(
        (800, 600), (538.63, 539.723), (457.698, 297.003), -0.30678, 0.0825017, 0.0028784, -0.00015829,
    ),
    "EuRoC's camera, Kalibr": _lens(
        (752, 480), (458.9432286546919, 457.5637533402653), (367.0272509347057, 249.3128033381081),
        -0.2879529995338575, 0.0781311194952221, 0.00021265916642721963, -0.0001221450347654466,
    ),
    "thermal camera, Kalibr": _lens(
        (640, 512), (404.9842534577856, 405.0992911907136), (313.1521147858522, 237.73982476898445),
        -0.3418843277284295, 0.09554844659447544, 0.0006766728551819399, 0.00013250437150091342,
    ),
    "stereo camera, Kalibr": _lens(
        _VGA, (509.05525532054565, 509.7717036288223), (315.04780418913816, 232.2210468373924),
        -0.393755886723044, 0.1578236986777623, 0.001656356049571968, 0.00032067252192923034,
    ),
    "car's camera, rational": _lens(
        (2880, 1860), (1495.316895, 1494.778564), (1424.459106, 943.463684),
        0.929988205433, 0.165922805667, -0.000024369263, -0.000013859207,
        0.002885974478, 1.331432461739, 0.435830116272, 0.027607271448, model="rational_polynomial",
    ),
    "HD camera, rational": _lens(
        _HD, (986.3321089, 981.6186107), (640.1575794, 500.6903186),
        0.2624628475, 0.1102693035, -0.001259269067, -2.317268492e-05,
        0.2807165481, 0.2516554863, 0.1878639645, 0.1083906076, model="rational_polynomial",
    ),
    "OAK-D's preview, rational": _lens(
        (250, 250), (202.61964416503906, 202.61964416503906), (124.34600067138672, 127.28642272949219),
        -3.4751670360565186, -38.5734748840332, 0.000343096033, -9.377215610584244e-05,
        286.4400939941406, -3.6408045291900635, -36.68898010253906, 279.0523681640625, model="rational_polynomial",
    ),
    "another OAK-D's, rational": _lens(
        (250, 250), (196.50531005859375, 196.50531005859375), (126.86713409423828, 125.84786987304688),
        -4.860828876495361, 17.2819766998291, 0.00020376102474983782, 0.0010251018684357405,
        -25.172250747680664, -4.943647384643555, 17.51442527770996, -25.290760040283203, model="rational_polynomial",
    ),
    "Go2's camera, fisheye": _lens(
        _HD, (797.4756164864929, 796.4872112769983), (643.5352167821186, 349.2783605343087),
        -0.07309428880537933, -0.02341140740909078, -0.0069305931780026956, 0.009238684484464793, model="equidistant",
    ),
    "drone's camera, 1280 x 800, fisheye": _lens(
        (1280, 800), (460.99, 460.79), (621.58, 382.33), 0.0598, 0.00741, -0.00571, 0.00185, model="equidistant",
    ),
    "drone's camera, fisheye": _lens(
        _VGA, (274.67864809280735, 274.77449225099258), (282.26163903128372, 245.63184086611827),
        0.0029236697411761372, 0.0015502028713279615, 0.0, 0.0, model="equidistant",
    ),
    "wide camera, fisheye": _lens(
        _VGA, (266.03143310546875, 264.33270263671875), (307.1657409667969, 244.2731475830078),
        0.02362927647301538, 0.010092809609273667, -0.02946640913386099, 0.00827924994219285, model="equidistant",
    ),
    "stereo camera, fisheye": _lens(
        (752, 480), (461.487246372674, 460.1113992557959), (356.39105303227853, 231.15719697054647),
        -0.0016509958435871643, 0.02437222940989351, -0.03582816956989852, 0.019860839087717054, model="equidistant",
    ),
}
