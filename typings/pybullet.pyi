"""The part of PyBullet that `soter_sim` uses (PyBullet ships no types). Quaternions are (x, y, z, w)."""

from collections.abc import Sequence
from typing import TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
JointState: TypeAlias = tuple[float, float, tuple[float, float, float, float, float, float], float]
# Flag, bodies A and B, links A and B, positions on A and B, normal on B, distance, normal force, then two
# frictions: force and direction of each.
ContactPoint: TypeAlias = tuple[
    int, int, int, int, int, Vector, Vector, Vector, float, float, float, Vector, float, Vector
]

COV_ENABLE_GUI: int
COV_ENABLE_SHADOWS: int
DIRECT: int
ER_TINY_RENDERER: int
GEOM_BOX: int
GEOM_MESH: int
GEOM_CYLINDER: int
GEOM_PLANE: int
GEOM_SPHERE: int
GUI: int
JOINT_PRISMATIC: int
JOINT_REVOLUTE: int
VELOCITY_CONTROL: int

class error(Exception): ...

def connect(method: int, key: int = ..., options: str = "") -> int: ...
def disconnect(physicsClientId: int = 0) -> None: ...
def configureDebugVisualizer(flag: int, enable: int = ..., *, physicsClientId: int = 0) -> None: ...
def resetDebugVisualizerCamera(
    cameraDistance: float,
    cameraYaw: float,
    cameraPitch: float,
    cameraTargetPosition: Sequence[float],
    physicsClientId: int = 0,
) -> None: ...
def setGravity(gravX: float, gravY: float, gravZ: float, physicsClientId: int = 0) -> None: ...
def setTimeStep(timeStep: float, physicsClientId: int = 0) -> None: ...
def setPhysicsEngineParameter(
    *,
    fixedTimeStep: float = ...,
    numSolverIterations: int = ...,
    numSubSteps: int = ...,
    useSplitImpulse: int = ...,
    splitImpulsePenetrationThreshold: float = ...,
    collisionFilterMode: int = ...,
    contactBreakingThreshold: float = ...,
    enableFileCaching: int = ...,
    restitutionVelocityThreshold: float = ...,
    erp: float = ...,
    contactERP: float = ...,
    frictionERP: float = ...,
    enableConeFriction: int = ...,
    deterministicOverlappingPairs: int = ...,
    solverResidualThreshold: float = ...,
    contactSlop: float = ...,
    physicsClientId: int = 0,
) -> None: ...
def stepSimulation(physicsClientId: int = 0) -> None: ...
def createCollisionShape(
    shapeType: int,
    radius: float = ...,
    halfExtents: Sequence[float] = ...,
    height: float = ...,
    planeNormal: Sequence[float] = ...,
    vertices: Sequence[Sequence[float]] = ...,
    indices: Sequence[int] = ...,
    physicsClientId: int = 0,
) -> int: ...
def createVisualShape(
    shapeType: int,
    radius: float = ...,
    halfExtents: Sequence[float] = ...,
    length: float = ...,
    visualFramePosition: Sequence[float] = ...,
    vertices: Sequence[Sequence[float]] = ...,
    indices: Sequence[int] = ...,
    rgbaColor: Sequence[float] = ...,
    specularColor: Sequence[float] = ...,
    physicsClientId: int = 0,
) -> int: ...
def computeViewMatrixFromYawPitchRoll(
    cameraTargetPosition: Sequence[float],
    distance: float,
    yaw: float,
    pitch: float,
    roll: float,
    upAxisIndex: int,
    physicsClientId: int = 0,
) -> tuple[float, ...]: ...
def computeProjectionMatrixFOV(
    fov: float, aspect: float, nearVal: float, farVal: float, physicsClientId: int = 0
) -> tuple[float, ...]: ...
def getCameraImage(
    width: int,
    height: int,
    viewMatrix: Sequence[float] = ...,
    projectionMatrix: Sequence[float] = ...,
    lightDirection: Sequence[float] = ...,
    lightColor: Sequence[float] = ...,
    shadow: int = ...,
    lightAmbientCoeff: float = ...,
    lightDiffuseCoeff: float = ...,
    lightSpecularCoeff: float = ...,
    renderer: int = ...,
    physicsClientId: int = 0,
) -> tuple[int, int, Sequence[int], Sequence[float], Sequence[int]]: ...
def createMultiBody(
    baseMass: float = 0.0,
    baseCollisionShapeIndex: int = -1,
    baseVisualShapeIndex: int = -1,
    basePosition: Sequence[float] = ...,
    baseOrientation: Sequence[float] = ...,
    linkMasses: Sequence[float] = ...,
    linkCollisionShapeIndices: Sequence[int] = ...,
    linkVisualShapeIndices: Sequence[int] = ...,
    linkPositions: Sequence[Sequence[float]] = ...,
    linkOrientations: Sequence[Sequence[float]] = ...,
    linkInertialFramePositions: Sequence[Sequence[float]] = ...,
    linkInertialFrameOrientations: Sequence[Sequence[float]] = ...,
    linkParentIndices: Sequence[int] = ...,
    linkJointTypes: Sequence[int] = ...,
    linkJointAxis: Sequence[Sequence[float]] = ...,
    physicsClientId: int = 0,
) -> int: ...
def setCollisionFilterGroupMask(
    bodyUniqueId: int,
    linkIndexA: int,
    collisionFilterGroup: int,
    collisionFilterMask: int,
    physicsClientId: int = 0,
) -> None: ...
def changeDynamics(
    bodyUniqueId: int,
    linkIndex: int,
    *,
    mass: float = ...,
    lateralFriction: float = ...,
    spinningFriction: float = ...,
    rollingFriction: float = ...,
    restitution: float = ...,
    linearDamping: float = ...,
    angularDamping: float = ...,
    contactStiffness: float = ...,
    collisionMargin: float = ...,
    contactDamping: float = ...,
    ccdSweptSphereRadius: float = ...,
    activationState: int = ...,
    jointDamping: float = ...,
    localInertiaDiagonal: Sequence[float] = ...,
    physicsClientId: int = 0,
) -> None: ...
def getJointStates(
    bodyUniqueId: int, jointIndices: Sequence[int], physicsClientId: int = 0
) -> tuple[JointState, ...]: ...
def resetJointState(
    bodyUniqueId: int,
    jointIndex: int,
    targetValue: float,
    targetVelocity: float = 0.0,
    physicsClientId: int = 0,
) -> None: ...
def setJointMotorControlArray(
    bodyUniqueId: int,
    jointIndices: Sequence[int],
    controlMode: int,
    *,
    targetPositions: Sequence[float] = ...,
    targetVelocities: Sequence[float] = ...,
    forces: Sequence[float] = ...,
    physicsClientId: int = 0,
) -> None: ...
def getBasePositionAndOrientation(bodyUniqueId: int, physicsClientId: int = 0) -> tuple[Vector, Quaternion]: ...
def resetBasePositionAndOrientation(
    bodyUniqueId: int, posObj: Sequence[float], ornObj: Sequence[float], physicsClientId: int = 0
) -> None: ...
def getContactPoints(
    bodyA: int = ..., bodyB: int = ..., linkIndexA: int = ..., linkIndexB: int = ..., physicsClientId: int = 0
) -> tuple[ContactPoint, ...]: ...
def getClosestPoints(
    bodyA: int,
    bodyB: int,
    distance: float,
    linkIndexA: int = ...,
    linkIndexB: int = ...,
    physicsClientId: int = 0,
) -> tuple[ContactPoint, ...]: ...
