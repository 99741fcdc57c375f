"""The arch under a leg (`mounted.py`) as MJCF, about the pose in which it stands: what makes mjcf/mounted_arch.xml.

The tree is that of foot_arch.xml on a body of its own, the sole, which the fat pad carries; two equalities keep heel
and metatarsal heads on the sole. The load on the apex is an actuator of constant force, and each ligament has the
tension of the pose, so that the stepped model has the stiffness of the springs *and* of the load's geometry.
"""

from dataclasses import replace

import numpy as np

from fasbody.arch.bones import Arch
from fasbody.arch.kinematics import Array, arms, closing_angle, deformations, gradients
from fasbody.arch.lagrange import mass_matrix
from fasbody.arch.load import poses, tangent
from fasbody.arch.mounted import FOOT_KG, SEATED_N, SHANK_KG, SHIPPED, THIGH_KG, TISSUE_KG, Mounted, pad
from fasbody.constants import MODEL_GRAVITY
from fasbody.exceptions import SimulationError

#: Coordinates of `matrices`, in order.
COORDINATES = ("z_F", "z_T", "theta_2", "theta_3", "theta_4", "z_H", "z_A")
_STEP = 1e-30
_JOINTS = ("spring_ligament", "short_plantar_ligament", "long_plantar_ligament")


def pose(mounted: Mounted, arch: Arch, weight: float) -> Array:
    """Coordinates (6,) of the arch under a load [N].

    Raises:
        SimulationError: the arch collapses under it.
    """
    q, stands = poses(arch, np.array(weight), mounted.tissue)
    if not stands:
        raise SimulationError(f"the arch collapses under {weight:g} N.")
    return q


def matrices(
    mounted: Mounted = SHIPPED, arch: Arch | None = None, weight: float = SEATED_N, added_kg: float = 0.0
) -> tuple[Array, Array, Array, Array]:
    """Mass, damping and stiffness (7, 7) about the pose, and rows (2, 7) of malleolus and tuberosity.

    In the coordinates of `COORDINATES`. Dampers of the arch are `lag` times the stiffness of its tissue; `Mounted`
    takes `lag` times the whole stiffness, the load's geometry among it.

    Args:
        mounted: the leg.
        arch: the bones, None for `Arch.nominal()`.
        weight: on the arch [N].
        added_kg: on the knee.
    """
    arch = arch or Arch.nominal()
    q = pose(mounted, arch, weight)
    a, g, unit = arms(arch, q), gradients(arch, q), np.eye(7)
    apex = np.array([1, 0, -a.l_2, -a.l_3, -a.l_4, 0, 0])
    shank, flesh = apex + unit[1], FOOT_KG - arch.m_F
    M, C, K = np.zeros((7, 7)), np.zeros((7, 7)), np.zeros((7, 7))
    M[:5, :5] = mass_matrix(replace(arch, m_T=1e-12), q)[:5, :5]
    carried = (
        (flesh * (1 - mounted.up), unit[0]), (flesh * mounted.up + SHANK_KG * mounted.share, apex),
        (SHANK_KG * (1 - mounted.share), shank), (THIGH_KG, shank + unit[5]), (TISSUE_KG + added_kg, shank + unit[6]),
    )  # fmt: skip
    for mass, row in carried:
        M += mass * np.outer(row, row)
    K[2:5, 2:5] = -tangent(arch, q, weight, mounted.tissue)
    for (_, k, _), slope in zip(_ligaments(mounted, arch, q), (g.d_2, g.d_3, g.d_4), strict=True):
        C[:5, :5] += mounted.lag * k * np.outer(slope[:5], slope[:5])
    k_11 = float(mounted.tissue.tangent(deformations(arch, q).e))
    C[:5, :5] += mounted.lag * k_11 * np.outer(g.e[:5], g.e[:5])
    m = mounted
    for i, k, c in ((0, pad(m.k_F, weight), m.c_F), (1, m.k_T, m.c_T), (5, m.k_H, m.c_H), (6, m.k_A, m.c_A)):
        K[i, i] += k
        C[i, i] += c
    return M, C, K, np.stack([apex, shank])


def response(frequency_hz: Array, mass: Array, damping: Array, stiffness: Array, rows: Array) -> Array:
    """Accelerations (r, f) of rows (r, 7) over that of the table, from the matrices (7, 7), at (f,) [Hz]."""
    s = 2j * np.pi * np.asarray(frequency_hz, float).reshape(-1, 1, 1)
    push = np.broadcast_to(-mass[:, :1], (s.shape[0], len(mass), 1))  # the first coordinate moves all as the table does
    x = np.linalg.solve(s**2 * mass + s * damping + stiffness, push)[..., 0]
    ratios: Array = (1 + s[:, 0] ** 2 * (x @ rows.T)).T
    return ratios


def _ligaments(mounted: Mounted, arch: Arch, q: Array) -> list[tuple[float, float, float]]:
    """Moment [N m], stiffness [N m/rad] and where its spring is at rest [rad from the pose], of the three joints."""
    d, ligaments = deformations(arch, q), []
    for joint, turn in ((2, d.d_2), (3, d.d_3), (4, d.d_4)):
        moment = float(mounted.tissue.moment(joint, turn))
        k = float(mounted.tissue.moment(joint, turn + 1j * _STEP).imag / _STEP)
        ligaments.append((moment, k, -moment / k))
    return ligaments


def mjcf(
    mounted: Mounted = SHIPPED, arch: Arch | None = None, weight: float | None = None, added_kg: float = 0.0
) -> str:
    """The model as MJCF.

    Args:
        mounted: the leg.
        arch: the bones, None for `Arch.nominal()`.
        added_kg: on the knee.
        weight: on the arch [N]; None for a seated leg with what is added.
    """
    weight = SEATED_N + MODEL_GRAVITY * added_kg if weight is None else weight
    arch = arch or Arch.nominal()
    q = pose(mounted, arch, weight)
    a, theta_1, flesh = arms(arch, q), float(closing_angle(arch, q)), FOOT_KG - arch.m_F
    e = float(deformations(arch, q).e)
    tension, k_11 = float(mounted.tissue.tension(np.array(e))), float(mounted.tissue.tangent(np.array(e)))
    angles = (theta_1, *map(float, q[2:5]))
    behind, front = -arch.L_1 * np.sin(theta_1), float(a.l_2 + a.l_3 + a.l_4)
    fascia = ""
    if k_11 > 0:
        at_rest = float(front - behind - tension / k_11)
        spring = f'stiffness="{k_11!r}" springlength="{at_rest!r}" damping="{float(mounted.lag * k_11)!r}"'
        fascia = f'    <spatial name="plantar_aponeurosis" {spring}>\n'
        fascia += '      <site site="heel"/><site site="heads"/>\n    </spatial>\n'
    text = _BONES
    for i, (joint, (_, k, ref)) in enumerate(zip(_JOINTS, _ligaments(mounted, arch, q), strict=True), 2):
        spring = f'name="{joint}" stiffness="{k!r}" springref="{ref!r}" damping="{float(mounted.lag * k)!r}"'
        m, L, I = (getattr(arch, f"{what}_{i}") for what in "mLI")  # noqa: E741
        turn = angles[0] + angles[1] if i == 2 else angles[i - 1] - angles[i - 2]
        place = 0.0 if i == 2 else -getattr(arch, f"L_{i - 1}")
        text = text.replace(f"@{i}", _BONE.format(
            name=("navicular", "cuneiforms", "metatarsals")[i - 2], place=place, turn=turn, spring=spring,
            middle=-L / 2, m=m, I=I, L=-L, pad=" " * (2 * i), more=f"@{i + 1}" if i < 4 else _HEADS.format(L=-L),
        ))  # fmt: skip
    values = {
        "weight": weight, "added": added_kg, "k_F": float(pad(mounted.k_F, weight)), "c_F": mounted.c_F,
        "k_T": mounted.k_T, "c_T": mounted.c_T,
        "k_H": mounted.k_H, "c_H": mounted.c_H, "k_A": mounted.k_A, "c_A": mounted.c_A,
        "sole": flesh * (1 - mounted.up), "apex": flesh * mounted.up + SHANK_KG * mounted.share,
        "shank": SHANK_KG * (1 - mounted.share), "thigh": THIGH_KG, "tissue": TISSUE_KG, "height": float(a.E_2),
        "behind": float(behind), "front": front, "turn_1": -theta_1, "m_1": arch.m_1, "I_1": arch.I_1,
        "L_1": -arch.L_1, "middle_1": -arch.L_1 / 2, "fascia": fascia,
    }  # fmt: skip
    for name, value in values.items():
        text = text.replace(f"#{name}#", value if isinstance(value, str) else repr(float(value)))
    return text


_BONE = """<body name="{name}" pos="0 {place!r} 0" euler="0 0 {turn!r}">
{pad}          <joint {spring}/>
{pad}          <inertial pos="0 {middle!r} 0" mass="{m!r}" diaginertia="{I!r} {I!r} {I!r}"/>
{pad}          <geom name="{name}" fromto="0 0 0 0 {L!r} 0" size="0.008"/>
{pad}          {more}
{pad}        </body>"""
_HEADS = '<site name="heads" pos="0 {L!r} 0"/>'
_BONES = """<mujoco model="mounted_arch">
  <!-- The five-body arch under the leg of leg.xml, x towards the toes, y up, about the pose in which it stands under
       #weight# N; made by fasbody.arch.mount from the shipped set of docs/arch.md (fitted to thirteen measurements, so
       no evidence for them), bones of Table 4.1. Another leg or load: fasbody.arch.mount.mjcf. The sole stands on the
       fat pad; two equalities keep heel and heads on it. The actuator weight is the static load on the apex, and
       each ligament's springref lets it carry that, so that the load's geometry counts. At small loads the aponeurosis
       is slack and is left out. Angles in rad, SI units. Each damper stands twice, as in foot_arch.xml. -->
  <compiler angle="radian" autolimits="true"/>
  <option timestep="1e-4" integrator="implicitfast" gravity="0 0 0" tolerance="1e-10" iterations="20"/>
  <statistic center="0 0.2 0" extent="0.8" meansize="0.05"/>
  <size nuser_jnt="8"/>

  <custom>
    <!-- unit | lower | upper | where the number stands | its source. -->
    <text name="k_F" data="N/m | 3e3 | 1e6 | joint fat_pad stiffness | fitted; Baines 2018, Kinoshita 1993"/>
    <text name="c_F" data="N s/m | 1 | 6e3 | joint fat_pad user 1 | fitted"/>
    <text name="k_T" data="N/m | 3e3 | 1e6 | joint talocrural stiffness | fitted; Aruin 1.49e4 +- 0.35e4"/>
    <text name="c_T" data="N s/m | 1 | 3e3 | joint talocrural user 1 | fitted; Aruin 430 +- 36"/>
    <text name="k_H" data="N/m | 1e3 | 1e6 | joint thigh stiffness | fitted"/>
    <text name="c_H" data="N s/m | 1 | 3e3 | joint thigh user 1 | fitted"/>
    <text name="k_A" data="N/m | 1e3 | 1e6 | joint tissue stiffness | fitted"/>
    <text name="c_A" data="N s/m | 1 | 3e3 | joint tissue user 1 | fitted"/>
    <text name="m_K" data="kg | 0.3 | 10 | body shank mass | as leg.xml"/>
    <!-- No added_mass: a load moves the pose, and with it pad and ligaments. README.md says how to make that model. -->
  </custom>

  <default>
    <joint type="slide" axis="0 1 0"/>
    <geom contype="0" conaffinity="0" mass="0"/>
    <default class="base">
      <joint armature="1e9"/>
      <geom type="box" rgba="0.35 0.38 0.42 1"/>
    </default>
    <default class="bone">
      <joint type="hinge" axis="0 0 1"/>
      <geom type="capsule" rgba="0.93 0.89 0.79 1"/>
      <site size="0.004" rgba="0.8 0.1 0.1 1"/>
    </default>
    <default class="column">
      <general gainprm="0"/>
    </default>
  </default>

  <worldbody>
    <body name="base">
      <joint name="base" class="base"/>
      <inertial pos="0 -0.03 0" mass="1" diaginertia="1e-2 1e-2 1e-2"/>
      <geom name="table" class="base" size="0.16 0.01 0.08" pos="0.03 -0.03 0"/>
      <site name="base"/>
      <body name="sole">
        <!-- what of the foot moves with heel and heads -->
        <joint name="fat_pad" stiffness="#k_F#" damping="#c_F#" user="4.25 #c_F# 0 0"/>
        <inertial pos="0 0 0" mass="#sole#" diaginertia="1e-3 1e-3 1e-3"/>
        <!-- one kilometre below heel and heads, so that both tendons stay vertical to 1e-9 -->
        <site name="heel_ground" pos="#behind# -1000 0"/>
        <site name="heads_ground" pos="#front# -1000 0"/>
        <body name="apex" pos="0 #height# 0">
          <!-- the malleolus' segment, and what of the foot moves with the apex -->
          <joint name="apex"/>
          <inertial pos="0 0.03 0" mass="#apex#" diaginertia="1e-3 1e-3 1e-3"/>
          <site name="malleolus" pos="0 0.05 0.03" size="0.008" rgba="0.8 0.1 0.1 1"/>
          <body name="shank">
            <joint name="talocrural" stiffness="#k_T#" damping="#c_T#" user="4.25 #c_T# 0 0"/>
            <inertial pos="0 0.2 0" mass="#shank#" diaginertia="1e-2 1e-2 1e-2"/>
            <geom name="shank" class="bone" fromto="0 0.06 0 0 0.37 0" size="0.02"/>
            <site name="tuberosity" pos="0.03 0.34 0" size="0.008" rgba="0.8 0.1 0.1 1"/>
            <body name="thigh">
              <joint name="thigh" stiffness="#k_H#" damping="#c_H#" user="4.25 #c_H# 0 0"/>
              <inertial pos="-0.2 0.45 0" mass="#thigh#" diaginertia="1e-2 1e-2 1e-2"/>
              <geom name="thigh" type="capsule" fromto="-0.4 0.45 0 -0.02 0.45 0" size="0.05" rgba="0.85 0.6 0.5 0.5"/>
            </body>
            <body name="tissue">
              <joint name="tissue" stiffness="#k_A#" damping="#c_A#" user="4.25 #c_A# 0 0"/>
              <inertial pos="0 0.5 0" mass="#tissue#" diaginertia="1e-3 1e-3 1e-3"/>
              <body name="load">
                <!-- no joint: it moves with the tissue -->
                <inertial pos="0 0.55 0" mass="#added#" diaginertia="0 0 0"/>
                <geom name="load" type="box" size="0.05 0.02 0.05" pos="0 0.55 0" rgba="0.3 0.3 0.35 1"/>
              </body>
            </body>
          </body>
          <body name="calcaneus_talus" euler="0 0 #turn_1#" childclass="bone">
            <joint name="hindfoot"/>
            <inertial pos="0 #middle_1# 0" mass="#m_1#" diaginertia="#I_1# #I_1# #I_1#"/>
            <geom name="calcaneus_talus" fromto="0 0 0 0 #L_1# 0" size="0.014"/>
            <site name="heel" pos="0 #L_1# 0"/>
            @2
          </body>
        </body>
      </body>
    </body>
  </worldbody>

  <tendon>
    <spatial name="heel_level"><site site="heel_ground"/><site site="heel"/></spatial>
    <spatial name="heads_level"><site site="heads_ground"/><site site="heads"/></spatial>
#fascia#  </tendon>

  <equality>
    <!-- Heel and heads stay on the sole. solref follows the step: -0.25/h^2, -1/h. -->
    <tendon name="heel_closure" tendon1="heel_level" solref="-2.5e7 -1e4" solimp="0.9999 0.9999 0.001"/>
    <tendon name="heads_closure" tendon1="heads_level" solref="-2.5e7 -1e4" solimp="0.9999 0.9999 0.001"/>
  </equality>

  <actuator>
    <!-- As in two_dof.xml: start time and the Taylor coefficients of the base acceleration. -->
    <general name="shaker" joint="base" gear="1e9" gainprm="0" biastype="user" biasprm="1"/>
    <general name="shaker_a0" class="column" joint="base"/>
    <general name="shaker_a1" class="column" joint="base"/>
    <general name="shaker_a2" class="column" joint="base"/>
    <general name="shaker_a3" class="column" joint="base"/>
    <!-- static load on the apex, in place of gravity -->
    <general name="weight" joint="apex" gainprm="0" biastype="affine" biasprm="-#weight# 0 0"/>
  </actuator>

  <sensor>
    <framelinacc name="base" objtype="site" objname="base"/>
    <framelinacc name="malleolus" objtype="site" objname="malleolus"/>
    <framelinvel name="malleolus_velocity" objtype="site" objname="malleolus"/>
    <framelinacc name="tuberosity" objtype="site" objname="tuberosity"/>
    <framelinvel name="tuberosity_velocity" objtype="site" objname="tuberosity"/>
  </sensor>
</mujoco>
"""
