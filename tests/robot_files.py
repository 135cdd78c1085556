"""Robot files that the tests of arms and simulator share: a small MJCF arm with everything, and a URDF."""

from __future__ import annotations

from pathlib import Path

MJCF = """
<mujoco model="small">
  <compiler autolimits="true" angle="radian" meshdir="elsewhere"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <asset><mesh name="shell" file="nowhere.stl"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="stand" pos="0.1 -0.2 0.3" euler="0.2 -0.1 0.4">
      <body name="shoulder" pos="0 0 0.2" euler="0.3 0 0">
        <inertial pos="0.01 0.02 0.05" mass="2.5" fullinertia="0.02 0.03 0.025 0.004 -0.003 0.002"/>
        <joint name="pan" axis="0.1 -0.2 1" pos="0.01 0 0.02" range="-2.5 2.5" armature="0.1" damping="0.5"/>
        <geom type="mesh" mesh="shell"/>
        <body name="upper" pos="0.05 0 0.1" euler="0 0.5 0">
          <inertial pos="0.1 0 0.02" mass="1.5" fullinertia="0.01 0.02 0.02 0.001 0 0.002"/>
          <joint name="lift" axis="0 -1 0" ref="0.3" range="-1.5 2" armature="0.08" frictionloss="0.2"/>
          <body name="slider" pos="0.25 0 0">
            <inertial pos="0 0 0.05" mass="0.8" diaginertia="0.002 0.002 0.001"/>
            <joint name="slide" type="slide" axis="1 0 0.2" range="-0.1 0.2" armature="2" stiffness="40"
              springref="0.02"/>
            <body name="wrist" pos="0.1 0 0">
              <inertial pos="0.02 0 0" mass="0.4" diaginertia="0.0004 0.0006 0.0005"/>
              <joint name="roll" axis="0 0 -1" range="-3 3" armature="0.02" damping="0.05"/>
              <site name="tip" pos="0.05 0.01 0.02" euler="0.4 0.2 -0.3"/>
              <body name="finger" pos="0.06 0 0">
                <inertial pos="0 0.01 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
                <joint name="grip" type="slide" axis="0 1 0" range="0 0.04"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="pan" kp="900" kv="60"/>
    <position joint="lift" kp="800" kv="60" forcerange="-60 60"/>
    <position joint="slide" kp="250" kv="20" gear="4"/>
    <position joint="roll" kp="60" kv="4"/>
    <position joint="grip" kp="10"/>
  </actuator>
  <sensor><framepos objtype="geom" objname="floor"/></sensor>
</mujoco>
"""

LINK = """
  <link name="{name}">
    <visual><geometry><mesh filename="package://nowhere/{name}.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://nowhere/{name}.stl"/></geometry></collision>
    <inertial>
      <origin xyz="0.02 0 0.1" rpy="0.1 0.2 0"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0.001" ixz="0" iyz="0.002"/>
    </inertial>
  </link>"""

JOINT = """
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/><child link="{child}"/><origin xyz="0.05 0 0.2" rpy="0.3 -0.2 0.1"/><axis xyz="{axis}"/>
    <limit lower="-1.5" upper="1.5" effort="80" velocity="2"/><dynamics damping="0.4" friction="0.3"/>
  </joint>"""

URDF = (
    '<robot name="plain"><link name="base"/>'
    + LINK.format(name="one")
    + LINK.format(name="two")
    + LINK.format(name="three")
    + '<link name="flange"/>'
    + JOINT.format(name="turn", kind="revolute", parent="base", child="one", axis="0 0 1")
    + JOINT.format(name="swing", kind="revolute", parent="one", child="two", axis="0 1 0")
    + JOINT.format(name="slide", kind="prismatic", parent="two", child="three", axis="1 0 0")
    + '<joint name="mount" type="fixed"><parent link="three"/><child link="flange"/><origin xyz="0 0 0.1"/></joint>'
    + "</robot>"
)


def write_mjcf(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the small arm with some texts replaced by others."""
    text = MJCF
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "small.xml"
    path.write_text(text, encoding="utf-8")
    return path


def write_urdf(folder: Path) -> Path:
    """Write the plain arm."""
    path = folder / "plain.urdf"
    path.write_text(URDF, encoding="utf-8")
    return path
