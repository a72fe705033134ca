"""The captions of the gallery: what a reader sees in each figure."""

PAGES = {
    "tuning": "A recorded right-angle turn, and the turn nearest to it that satisfies the limits of a city bus.",
    "conventions": "Two ways to read one quaternion: it changes the axes in which a vector is expressed (left), or it "
    "rotates the vector (right).",
    "trihedra": "A climbing, widening spiral-helix. The arrows are the natural trihedral at equal time steps.",
    "orientation": "Attitude along a helix. The quaternion stays finite, but the Gibbs vector is infinite where the "
    "angle reaches 180°.",
    "turns": "A slew of 90° with five profiles under the same limits on rate and acceleration: smoother profiles take "
    "longer.",
    "braking": "The fastest timing along a winding road, with 4 m/s² of braking and 1.5 m/s² of acceleration.",
    "by_speed": "The longitudinal acceleration over the speed, between a brake curve and a motor curve.",
    "obstacles": "A road past two obstacles, given and tuned for a car of three discs.",
    "atlas": "How fast a bus may enter a corner, over the radius at its entry: the duration of the fastest turn, and "
    "the limits that are met first.",
    "zones": "The fastest timing along the same road with a speed limit of 30 km/h from 150 m to 250 m.",
    "work_precision": "Which method propagates an attitude most accurately for its work: lower and farther left is "
    "better.",
    "closed_loop_errors": "How far simulated control loops are from the exact solution, for three integrators and "
    "several tolerances.",
    "recorded_gyro": "The rates of a recorded gyro, and the error of the attitude that is computed from them.",
    "work_and_time": "Accuracy against computing time: how long each method takes for a given angle error.",
    "throughput": "How many instants `evaluate` computes in a second, and how many are needed to use a machine fully.",
}
"""Captions of the figures of `docs/figures`, by the names of the figures."""

NOTEBOOKS = {
    "00_two_papers": [
        "The boundary conditions of a climbing turn: positions and velocities at the ends A and B.",
        "The path through these boundary conditions, with its natural trihedral.",
        "A turn whose curvature changes sign: the natural trihedral flips, and the attitude jumps.",
        "Forces and moments on a vehicle in the turn, and the friction and power that it needs.",
        "A turn about a fixed axis by 90°: time-optimal, and with a cubic profile.",
        "The same angle within a given time: cubic splines come close to the time-optimal turn.",
        "A disturbance without feedback makes the error grow; with feedback the error stays small.",
        "The simulated error of the feedback law agrees with its closed form to rounding error.",
    ],
    "10_recorded_turn": [
        "A recorded turn before and after tuning: curvature and lateral acceleration now satisfy their limits.",
        "Speed, torsion and rate of the same turn, which had no limits.",
    ],
    "20_orientation": [
        "A spiral ramp with its natural trihedral.",
        "The attitude up the ramp: only the Gibbs vector becomes infinite.",
        "An S-bend: the natural trihedral flips where the curvature changes sign.",
        "The same S-bend with the upright frame, whose attitude is continuous.",
    ],
    "30_turns_and_feedback": [
        "Five slew profiles for 90° under the same limits on rate and acceleration.",
        "Four feedback laws, released at rest 150° from the target.",
        "A slew with disturbance, saturation and sampling: a small error remains.",
        "A slew on reaction wheels: wrong inertia and weak wheels leave an error.",
    ],
    "40_propagation": [
        "Error against work for coning: each line falls with the order of its method.",
        "Attitude from a recorded gyro: the angle passes through 180° several times.",
    ],
    "50_tuning": [
        "One of many tuned turns: the curvature stays at its limit.",
        "The cost of a limit: the smaller the permitted curvature, the more the velocities must change.",
        "Three search methods, step by step: violation of the limits (left) and distance from the solution (right).",
    ],
    "55_truck": ["A turn of a truck whose tyres grip to 80 % of its weight: friction and power at their limits."],
    "60_gradients": [
        "Gains that are found from a recorded loop by gradients agree with the true gains.",
        "A path through all samples of a recording, found by gradients, and the path from its ends alone.",
    ],
    "65_optax": [
        "The loss of loops written by hand with four penalties, beside the optimum that `tune` proves.",
    ],
    "70_batches": ["Three of 64 control loops that were simulated in one call: larger gains settle faster."],
    "80_whole_drive": [
        "A drive of 8 km by car. Red marks where a city bus would violate its limits.",
        "The route of the bus: nowhere more than 0.75 m from the drive, and within all limits.",
    ],
    "90_fastest_timing": [
        "The fastest timing of a corner from rest; the colour shows which limit bounds the speed.",
        "A timing that satisfies limits at grid points violates them in between; the proved one does not.",
        "The fastest timing of a route with a stop.",
    ],
    "95_fastest_lap": ["The fastest line of a circuit and its speed, compared with the centre line."],
}
"""Captions of the figures of each notebook, in their order; a figure without a caption shows its section."""
