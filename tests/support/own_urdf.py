"""A URDF as a person writes it: comments, both quotation marks, links that armd does not need."""

OWN = """<?xml version='1.0' encoding="UTF-8"?>
<!-- <joint name="not one"><origin xyz="1 2 3"/></joint> -->
<robot name="own arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="world"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="base"/>
    <origin rpy='0 0 0.4' xyz='0.2 0 0.75'/>
  </joint>
  <link name="base"><visual><geometry><mesh filename="package://own/base.dae"/></geometry></visual></link>
  <joint name="shoulder" type="revolute">
    <!-- the drawing has 0.1625 -->
    <origin   xyz="0 0  0.1625"	rpy="0 0 0" />
    <parent link="base"/>
    <child link="link_1"/>
    <axis xyz="0 0 2"/>
    <limit lower="-2.9" upper="2.9" effort="150" velocity="3.14"/>
    <dynamics damping="0.5"/>
  </joint>
  <link name="link_1"><inertial><origin xyz="0 0 0.1"/><mass value="3.7"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="revolute">
    <parent link="link_1"/>
    <child link="link_2"/>
    <axis xyz="0 1 0"/>
    <origin rpy="0 1.570796326794896619 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <link name="link_2"/>
  <joint name="elbow" type="continuous">
    <parent link="link_2"/><child link="link_3"/>
    <axis xyz='0 1 0'/>
    <origin xyz="0.02 -0.1 0.42" rpy="0 0 0"/>
  </joint>
  <link name="link_3"/>
  <joint name="cover" type="fixed"><parent link="link_3"/><child link="shell"/>
    <origin xyz="0 0.05 0.3" rpy="0 0.1 0"/></joint>
  <link name="shell"/>
  <joint name="turn" type="revolute">
    <parent link="shell"/><child link="link_4"/>
    <origin xyz="0 0 0.09" quat_xyzw="0 0.70710678118654757 0 0.70710678118654757"/>
    <axis xyz="0 0 -1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <link name="link_4"/>
  <joint name="wrist" type="revolute">
    <parent link="link_4"/><child link="link_5"/>
    <limit lower="-1.9" upper="1.9" effort="1" velocity="1"/>
  </joint>
  <link name="link_5"/>
  <joint name="flange" type="fixed"><parent link="link_5"/><child link="tool0"/>
    <origin xyz="0.01 0 0.12" rpy="3.14159265358979 0 -1.5707963"/></joint>
  <link name="tool0"/>
  <joint name="finger" type="prismatic"><parent link="link_5"/><child link="left"/>
    <origin xyz="0 0.02 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <link name="left"/>
  <joint name="other_finger" type="prismatic"><parent link="link_5"/><child link="right"/>
    <mimic joint="finger" multiplier="-1"/><axis xyz="0 1 0"/></joint>
  <link name="right"/>
  <gazebo><plugin name="x"><joint name="deep"><origin xyz="9 9 9"/></joint></plugin></gazebo>
</robot>
<!-- the end -->
"""  # noqa: E501
