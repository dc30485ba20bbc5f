"""MJCF hands for tests: every kind of thing that people's files have, in a gripper of two fingers."""

#: A finger on a hinge whose position is 0.3 rad where the file draws it, and a fingertip on a slide.
LEFT = """
<body name="left" pos="-0.04 0 0.03" euler="0 0.2 0.1">
  <joint name="left" axis="0 1 0.1" pos="0.003 0.001 -0.002" range="-0.4 0.9" ref="0.3"/>
  <geom name="left_bar" class="bar"/>
  <body name="left_nail" pos="0 0 0.05" euler="0.1 0 0"><geom name="left_mesh" type="mesh" mesh="nail"/></body>
  <body name="left_tip" pos="0 0 0.05">
    <joint name="left_slide" type="slide" axis="1 0 0.2" range="-0.01 0.02" ref="0.004"/>
    <geom name="left_pad" class="pad"/>
  </body>
</body>"""
RIGHT = """
<body name="right" pos="0.04 0 0.03" euler="0 -0.2 0">
  <joint name="right" axis="0 -1 0" range="-0.4 0.9" ref="-0.1"/>
  <geom name="right_bar" class="bar"/>
  <geom name="right_pad" class="pad" pos="0 0 0.06"/>
</body>"""
PALM = '<geom name="palm_box" type="box" size="0.05 0.025 0.015" pos="0 0 0.015"/>'
MOTORS = '<position name="pull" joint="left" kp="20" forcerange="-2 2"/>'
SLIDE_MOTOR = '<position name="push" joint="left_slide" kp="500" forcerange="-10 10"/>'


def model(world: str, rest: str = "", actuators: str = MOTORS + SLIDE_MOTOR) -> str:
    """Return a file with this world, and further sections."""
    return f"""<mujoco model="made_up">
<compiler angle="radian"/>
<default>
  <geom density="700"/>
  <default class="bar"><geom type="capsule" size="0.005 0.02" pos="0 0 0.025"/></default>
  <default class="pad"><geom type="box" size="0.004 0.01 0.015" pos="0 0 0.02" mass="0.02"/></default>
</default>
<asset><mesh name="nail" vertex="-.01 -.004 0 .01 -.004 0 -.01 .004 0 .01 .004 0
  -.01 -.004 .02 .01 -.004 .02 -.01 .004 .02 .01 .004 .02"/></asset>
<worldbody>
{world}
</worldbody>
<equality><joint name="both" joint1="right" joint2="left" polycoef="0.05 0.8 0 0 0"/></equality>
{rest}
<actuator>{actuators}</actuator>
</mujoco>
"""


INERTIAL = '<inertial pos="0 0 0" mass="0.01" diaginertia="1e-4 1e-4 1e-4"/>'
#: A palm with two fingers.
PLAIN = model(f'<body name="palm" pos="0.1 0.2 0.3" euler="0.3 0.1 0.2">{PALM}{LEFT}{RIGHT}</body>')
#: Its parts stand beside each other in the world, with things around them.
BESIDE = model(
    f"""<geom name="floor" type="plane" size="1 1 0.1"/>
<geom name="base_plate" type="box" size="0.05 0.05 0.01" pos="0 0 -0.01" mass="0.2"/>
<body name="palm">{PALM}<body name="knob" pos="0.02 0 0"><geom type="sphere" size="0.01"/></body></body>
<body name="table" pos="0 0 -0.4"><geom type="box" size="0.5 0.5 0.1"/></body>
<body name="camera" pos="0.3 0 0.3"><geom type="box" size="0.01 0.01 0.01" contype="0" conaffinity="0"/></body>
<body name="cube" pos="0.3 0 0"><freejoint/><geom type="box" size="0.02 0.02 0.02"/></body>
<body name="ball" pos="0.3 0.1 0"><joint name="ball_x" type="slide" axis="1 0 0"/><joint name="ball_turn"/>
<geom size="0.02"/></body><body name="hook" mocap="true" pos="0 0 0.3"/>
{LEFT}{RIGHT}"""
)
#: The palm floats.
FLOATING = model(f'<body name="palm" pos="0.1 0 0.3"><freejoint name="float"/>{PALM}{LEFT}{RIGHT}</body>')
#: The palm is moved by six joints, all of one body.
SIX = model(
    f"""<body name="palm" pos="0.1 0 0.3" euler="0.1 0.2 0.3">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="z" type="slide" axis="0 0 1" ref="0.2"/><joint name="roll" axis="1 0 0"/>
<joint name="pitch" axis="0 1 0" ref="0.1"/><joint name="yaw" axis="0 0 1"/>{PALM}{LEFT}{RIGHT}</body>"""
)
#: The same, each joint on a body of its own.
SIX_BODIES = model(
    f"""<body name="rail" pos="0.1 0 0"><geom name="rail" type="box" size="0.01 0.01 0.01" mass="0.1"/>
<body name="bx"><joint name="x" type="slide" axis="1 0 0"/>{INERTIAL}
<body name="by"><joint name="y" type="slide" axis="0 1 0"/>{INERTIAL}
<body name="bz"><joint name="z" type="slide" axis="0 0 1"/>{INERTIAL}
<body name="palm" euler="0.2 0.3 0.1"><joint name="turn"/>{PALM}{LEFT}{RIGHT}</body></body></body></body></body>"""
)
#: The hand is on an arm, which stands beside a second hand.
ARM = model(
    f"""<body name="foot"><geom name="foot" type="box" size="0.05 0.05 0.05"/>
<body name="shoulder" pos="0 0 0.1"><joint name="shoulder" axis="0 0 1" range="-3 3"/>
<geom name="arm" type="capsule" size="0.03 0.1" pos="0 0 0.1"/>
<body name="palm" pos="0 0 0.25" euler="0.4 0 0"><joint name="wrist" axis="1 0 0" range="-1 1" ref="0.2"/>
{PALM}{LEFT}{RIGHT}</body></body></body>
<body name="other" pos="1 0 0"><geom type="box" size="0.05 0.05 0.05"/><body name="thumb" pos="0 0 0.1">
<joint name="thumb" axis="0 1 0" range="0 1"/><geom type="sphere" size="0.01"/></body></body>""",
    rest='<equality><joint joint1="thumb" joint2="shoulder"/>'
    '<connect body1="shoulder" body2="world" anchor="0 0 0"/></equality>',
)
