"""Robots in forms that are no URDF, as makers and users write them."""

from __future__ import annotations

DELTAS = {  # a published calibration of a UR10: Universal_Robots_ROS2_Driver, ur_calibration/test
    "delta_theta": [
        -7.290070070824746e-05, -0.01713897289704999, -0.03707159413492756, 0.054279462160583214,
        1.488984257025741e-07, 1.551499479707493e-05,
    ],
    "delta_a": [
        4.6311376834935676e-05, -0.00012568315331862312, 0.00186216581161458, 9.918593870679266e-05,
        4.215462720453189e-06, 0,
    ],
    "delta_d": [
        0.00065609212979853, 1.4442162376284788, 0.854147723854608, -2.2989425877563705,
        -1.573498686836816e-05, 1.9072435590711256e-05,
    ],
    "delta_alpha": [
        0.000211987863869334, -0.0072553625957652995, -0.013483226769541364, 0.0013495820227329425,
        -0.001263136163679901, 0,
    ],
}  # fmt: skip

UR_YAML = """kinematics:
  shoulder:
    x: 0
    y: 0
    z: 0.1273
    roll: -0
    pitch: 0
    yaw: 0
  upper_arm:
    x: 0.00012
    y: 0
    z: 0
    roll: 1.5702
    pitch: 0.0001
    yaw: -0.0002
  forearm: {x: -0.612, y: 0, z: 0, roll: 0.0007, pitch: -0.0009, yaw: 0.0003}
  wrist_1:   # nearly parallel
    x: -0.5723
    y: 0.0001
    z: 0.163941
    roll: 0.001
    pitch: 0.002
    yaw: 0.003
  wrist_2:
    x: 0
    y: -0.1157
    z: 1e-05
    roll: 1.57
    pitch: 0
    yaw: "0.0"
  wrist_3:
    x: 0
    y: 0.0922
    z: 0
    roll: 1.5707
    pitch: 3.1415
    yaw: 3.1414
  hash: calib_12788084448423163542
"""

FRANKA = """joint,a_m,d_m,alpha_deg,theta_deg,min_rad,max_rad
J1,0,0.333,0,0,-2.9,2.9
J2,0,0,-90,0,-1.8,1.8
J3,0,0.316,90,0,,
J4,0.0825,0,90,0,-3.1,0
J5,-0.0825,0.384,-90,0,-2.9,2.9
J6,0,0,90,0,0,3.8
J7,0.088,0,90,0,-2.9,2.9
flange,0,0.107,0,0,,
"""

MJCF = """<mujoco model="arm">
  <compiler angle="degree"/>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="10 20 30">
      <geom size="0.05" mass="3"/>
      <body name="one" pos="0 0 0.2" quat="0.9 0.1 0.2 0.3">
        <joint name="j1" axis="0 0 -1" pos="0.01 0.02 0.03" range="-90 90"/>
        <joint name="j2" axis="1 1 0" pos="0 0 0.05" ref="30"/>
        <geom size="0.05" mass="2" pos="0.1 0 0"/>
        <body name="two" pos="0.3 0 0.1">
          <joint name="j3" type="slide" axis="0 1 0" range="-0.2 0.4"/>
          <geom size="0.04" mass="1.5" pos="0 0.1 0"/>
          <body name="three" pos="0 0 0.4" euler="90 0 0">
            <joint name="j4" axis="0 1 0"/>
            <geom size="0.03" mass="1" pos="0 0 0.1"/>
            <site name="tcp" pos="0.02 0.03 0.2" euler="0 45 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

FAR_DELTAS = [  # two more, also of UR10s, whose axes 2 to 4 meet hundreds of metres away
    {
        "delta_theta": [
            1.59613525316931737e-07, -0.917209621528830232, 7.12936131346499469, 0.0710299029424392298,
            -1.64258976526054923e-06, 9.17286101034808787e-08,
        ],
        "delta_a": [
            0.000108651068627930392, 0.240324175250532346, 0.00180628180213493472, 2.63076149165684402e-05,
            3.96638632500012715e-06, 0,
        ],
        "delta_d": [
            -0.000144894975118076141, 303.469135666158195, -309.88394307789747, 6.41459904397394975,
            -4.48232900190081995e-05, -0.00087071402790364627,
        ],
        "delta_alpha": [
            -0.000444781952841921679, -0.00160215112531214153, 0.00631917793331091861, -0.00165055247340828437,
            0.000763682515545038854, 0,
        ],
    },
    {
        "delta_theta": [
            -2.41478068943590252e-07, 1.60233952386694556, -1.68607190752171299, 0.0837331147700118711,
            -1.01260355871157781e-07, 3.91986209186123702e-08,
        ],
        "delta_a": [
            2.12234865571205891e-05, 0.632017132627700651, 0.00229833638891230319, -4.61409023720933908e-05,
            -6.39280053471801522e-05, 0,
        ],
        "delta_d": [
            -0.000160188285741325043, 439.140974079900957, -446.027059806332147, 6.88618689642360149,
            -3.86588496858186748e-05, -0.00087908274257374186,
        ],
        "delta_alpha": [
            -0.000650246557584166496, 0.00139416666825590402, 0.00693818880325995126, -0.000811641562390219562,
            0.000411120504570705592, 0,
        ],
    },
]  # fmt: skip


def conf_of(deltas: dict[str, list[float]]) -> str:
    """A controller's calibration.conf."""
    lists = "\n".join(f"{key} = {values}" for key, values in deltas.items())
    return f"\n[mounting]\n# a comment\n{lists}\njoint_checksum = [1, 2, 3, 4, 5, 6]\n[other]\ndelta_d = 5\n"


UR10_CONF = conf_of(DELTAS)
