"""The one table of words by which the kind of a user's column is known: joints, places, poses, conditions."""

from __future__ import annotations

import re

from calib.text_files.column_names import listed, plain

WORDS = {
    kind: frozenset(listed(words))
    for kind, words in {
        "measured": "measured measurement measure meas gemessen mess laser lt tracker scanner jig smr reflector marker "
        "测量 实测 mesuré mesurée mesure misurato medido 測定値 測定 計測値 計測 实测值 测量值 gemessene istwert",
        "actual": "actual act ist",  # of a controller its own, but beside nominal ones
        "place": "point punkt position pos coordinate coord koordinate coordonnée 座標 坐标 p t",
        "marker": "marker reflector reflektor smr prism tag ball kugel aruco messpunkt "
        "cible マーカー ターゲット 标记 靶球",
        "label": "target marker markerid tagid childframeid pointname",
        "nominal": "nominal nom soll theoretical theo 名义 理论",
        "deviation": "deviation dev abweichung delta error 余量",
        "commanded": "desired command commanded cmd reference setpoint goal consigne sollwert 指令 目標",
        "read": "actual act ist istwert istposition measured meas feedback fb read is present state",
        "own": "tcp ee eef endeffector effector cartesian flange tool0 fk odom",  # computed by the controller
        "robot": "base frame nozzle robot controller steuerung calculated berechnet",
        "rate": "velocity vel speed acceleration acc force moment torque d",
        "no place": "r q f s u v w m sigma std ori roll euler quat cov rot rotation orientation quaternion normal imu "
        "gyro wrench dir uncertainty angular linear twist accelerometer gravity scale covariance offset",
        "no joint": "target ref velocities qd qdd dq ddq qdot current effort eff tau tq temperature temperatures temp "
        "voltage mode control action jerk tcp ip mt et aspos macur drehmoment geschwindigkeit vitesse",
        "turn": "rx ry rz roll pitch yaw rotation tilt a b c",
        "end of joint": "position pos positions angle value winkel grad 轴 軸 角度 关节 関節 "
        "轴角度 軸角度 关节角度 関節角度 角",
        "time": "time timestamp stamp zeit",
    }.items()
}
"""Words in the names of columns, by what they tell."""
MEANINGS = {
    meaning: listed(spellings)
    for meaning, spellings in {
        "pose": "pose poseid id name no nr number index idx measurement point pointname pointid config punkt messpunkt "
        "punktname punktnr repère pointno pointnr 测点 点号 測定点 測点 番号 序号 file",
        "role": "role set split",
        "target": "target reflector smr marker",
        "setup": "setup station",
        "payload_kg": "payload payloadmass load",
        "temperature_c": "temperature temp temperatur",
        "time_s": "time timestamp zeit",
        "scan": "scan scanfile",
    }.items()
}
"""Spellings, without signs and units, of columns that poses.csv and points.csv have, too."""
POLAR = {
    kind: listed(words)
    for kind, words in {
        "azimuth": "azimuth az azimuthangle hz hzangle ha horizontal horizontalangle horizontalwinkel richtung azimut "
        "azimutwinkel azimutal 水平角 方位角",
        "zenith": "zenith zenithangle vz zenit zenitwinkel zenitdistanz zénith 天顶角 天頂角",
        "elevation": "elevation elevationangle el altitude höhenwinkel hoehenwinkel élévation 仰角 高度角",
        "height": "v va vertical verticalangle vertikalwinkel",
        "distance": "distance dist d range slopedistance slopedist sd schrägdistanz schrägstrecke strecke distanz "
        "entfernung radius r 斜距 距离 距離",
    }.items()
}
"""Spellings of the angles and the distance by which total stations and trackers tell a point."""
SERIES = (  # joints that some makers name and do not number
    listed("base shoulder elbow wrist1 wrist2 wrist3"),
    listed("shoulderpan shoulderlift elbow wrist1 wrist2 wrist3"),
    listed("s l u r b t"),
)
AXES = {"easting": "x", "northing": "y", "elevation": "z"}  # of surveyors


def words_of(name: str, *, apart: bool = True) -> set[str]:
    """Words of a column's name, in lower case; with `apart` numbers are words of their own."""
    return {word for word in re.split(r"[\W_]+|(?<=[^\W\d_])(?=\d)" if apart else r"[\W_]+", name.lower()) if word}


def is_called(name: str, *kinds: str, apart: bool = True) -> bool:
    """Whether a word of a column's name is of one of some kinds."""
    return any(words_of(name, apart=apart) & WORDS[kind] for kind in kinds)


def is_own(name: str) -> bool:
    """Whether a pose is named as one that the controller computes or is commanded, which measures nothing."""
    return is_called(name, "own", "commanded", apart=False) or {"target", "pose"} <= words_of(name)


def kind_of_marker(name: str) -> str:
    """What markers of one kind have in common: a word for them, or their name without numbers and single letters."""
    if any(word.startswith(tuple(WORDS["marker"])) for word in words_of(name)):
        return "marker"
    return plain(re.sub(r"\d+|(?<![^\W_])[A-Za-z](?![^\W_])", "9", name) or "9")
