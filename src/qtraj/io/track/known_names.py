"""Names that columns have in the files of other programs."""

import itertools
import re

COMMON = {
    "time": ("time", "t", "timestamp", "seconds"),
    "position": (
        "x,y,z",
        "px,py,pz",
        "pos_x,pos_y,pos_z",
        "position_x,position_y,position_z",
        "easting,northing,altitude",
        "east,north,up",
        "tx,ty,tz",
    ),
    "velocity": (
        "vx,vy,vz",
        "vel_x,vel_y,vel_z",
        "velocity_x,velocity_y,velocity_z",
        "vel_east,vel_north,vel_up",
        "ve,vn,vu",
    ),
    "attitude": ("qw,qx,qy,qz", "q_w,q_x,q_y,q_z", "quaternion_w,quaternion_x,quaternion_y,quaternion_z"),
    "rate": (
        "angvel_x,angvel_y,angvel_z",
        "wx,wy,wz",
        "gyro_x,gyro_y,gyro_z",
        "omega_x,omega_y,omega_z",
        "rate_x,rate_y,rate_z",
        "angvel_z",
        "wz",
        "gyro_z",
        "omega_z",
        "vertical_rate",
    ),
}
"""Column names that are recognised automatically; one of them without the others makes a quantity incomplete."""

NED_POSITION = ("north,east,down", "n,e,d", "pn,pe,pd", "pos_n,pos_e,pos_d", "pos_north,pos_east,pos_down")
NED_VELOCITY = (
    "vn,ve,vd",
    "vel_n,vel_e,vel_d",
    "vel_north,vel_east,vel_down",
    "velocity_north,velocity_east,velocity_down",
    "v_north,v_east,v_down",
)
ENU_POSITION = (
    "easting,northing,altitude",
    "easting,northing,height",
    "easting,northing,elevation",
    "easting,northing,h_ell",
    "east,north,up",
    "e,n,u",
    "pe,pn,pu",
    "pos_e,pos_n,pos_u",
    "rechtswert,hochwert,höhe",
    "rechtswert,hochwert,hoehe",
)
ENU_VELOCITY = (
    "vel_east,vel_north,vel_up",
    "ve,vn,vu",
    "vel_e,vel_n,vel_u",
    "velocity_east,velocity_north,velocity_up",
    "v_east,v_north,v_up",
)

MORE = {
    "time": [
        "stamp",
        "time_stamp",
        "ts",
        "sec",
        "secs",
        "datetime",
        "date_time",
        "utc",
        "utc_time",
        "time_utc",
        "gps_time",
        "unix_time",
        "unix",
        "epoch",
        "elapsed",
        "elapsed_time",
        "time_boot",
        "time_us",
        "time_ms",
        "time_ns",
        "time_min",
        "time_h",
        "utime",
        "gpst",
        "zeit",
        "milliseconds",
        "microseconds",
        "nanoseconds",
        "base_date_time",
        "tow",
        "time_of_week",
        "gps_tow",
        "sow",
        "itow",
        "date",
    ],
    "position": (
        *ENU_POSITION,
        *NED_POSITION,
        "p_rs_r_x,p_rs_r_y,p_rs_r_z",
        "x_pos,y_pos,z_pos",
        "p1,p2,p3",
        "pos1,pos2,pos3",
        "position1,position2,position3",
    ),
    "velocity": (
        *ENU_VELOCITY,
        *NED_VELOCITY,
        "v_rs_r_x,v_rs_r_y,v_rs_r_z",
        "v_x,v_y,v_z",
        "x_velocity,y_velocity,z_velocity",
        "v1,v2,v3",
        "vel1,vel2,vel3",
        "velocity1,velocity2,velocity3",
    ),
    "attitude": (
        "q_rs_w,q_rs_x,q_rs_y,q_rs_z",
        "quat_w,quat_x,quat_y,quat_z",
        "orientation_w,orientation_x,orientation_y,orientation_z",
        "rotation_w,rotation_x,rotation_y,rotation_z",
        "rot_w,rot_x,rot_y,rot_z",
    ),
    "rate": ("angular_velocity_x,angular_velocity_y,angular_velocity_z",),
}
"""Further names, which are recognised only if all columns of a quantity have them."""

ANGLED = ("roll,pitch,heading", "roll,pitch,yaw", "roll,pitch,azimuth")
GLOBAL = tuple(
    ",".join(name for name in names if name)
    for names in itertools.product(
        ("latitude", "lat", "position_lat", "pos_lat"),
        ("longitude", "lon", "lng", "long", "position_long", "pos_lon"),
        (
            *("height", "altitude", "alt", "elevation", "ele", "h", "h_ell", "hgt", "alt_msl", "altitude_msl", "elev"),
            *("pos_alt", "geo_altitude", "baro_altitude", ""),
        ),
    )
)
"""Common column names of geographic positions (`GLOBAL`) and of attitudes as angles (`ANGLED`)."""

FLAT = (
    "x,y",
    "rechtswert,hochwert",
    "px,py",
    "pos_x,pos_y",
    "position_x,position_y",
    "easting,northing",
    "east,north",
    "e,n",
    "tx,ty",
)
FLAT_VELOCITY = (
    "vx,vy",
    "vel_x,vel_y",
    "velocity_x,velocity_y",
    "v_x,v_y",
    "x_velocity,y_velocity",
    "vel_east,vel_north",
    "ve,vn",
)
"""Names of horizontal positions and velocities, whose heights are 0."""

HEIGHTS = {"z", "h", "height", "alt", "altitude", "altitud", "elevation", "ele", "up", "u", "down", "d", "hgt", "depth"}
"""Names of columns that may be the height of a position."""

MATRICES = tuple(
    ",".join(f"{prefix}{i}{j}" for i in digits for j in digits)
    for prefix in ("r", "rot", "rotation", "m", "rotation_matrix", "rotm")
    for digits in ("123", "012")
)
"""Names of the elements of rotation matrices from body to world axes, row by row."""

UNORDERED = tuple(
    ",".join(f"{prefix}{k}" for k in digits)
    for prefix in ("q", "quat", "quaternion", "orientation", "att", "attitude", "q_rs")
    for digits in ("0123", "1234")
)
"""Names of quaternions that do not tell which component is the scalar."""

DATE_AND_CLOCK = tuple(
    f"{date},{clock}"
    for date in ("date", "day", "utc_date", "gps_date", "local_date", "date_utc")
    for clock in (
        "time",
        "clock",
        "utc_time",
        "time_of_day",
        "utc",
        "gps_time",
        "local_time",
        "tod",
        "time_utc",
        "hour",
    )
)

_OTHERS = (
    "s,n,ds,v,vel,distance,arc_length,station,ax,ay,a,acceleration,accel,ax_mps2,steering,delta,throttle,brake,yaw_rate,"
    "omega,w_tr_right,w_tr_left,width,width_left,width_right,battery,voltage,current,temperature,status,mode,fix,"
    "quality,sats,satellites,hdop,vdop,pdop,count,seq,index,frame,frame_id,name,id,type,label,note,comment,rssi,hr,"
    "std_x,std_y,sigma_x,sigma_y,angle,pos,year,month,day,hour,minute,min,second"
)

WHOLE_AND_NANOSECONDS = (
    "sec,nsec",
    "secs,nsecs",
    "sec,nanosec",
    "stamp_sec,stamp_nanosec",
    "stamp_secs,stamp_nsecs",
    "stamp_sec,stamp_nsec",
    "seconds,nanoseconds",
    "time_sec,time_nsec",
)
"""Names of two columns with whole seconds and nanoseconds."""

OBJECTS = ["mmsi", "imo", "track_id", "vehicle_id", "vessel_id", "object_id", "trip_id", "device_id", "agent_id", "id"]
"""Columns that tell which of several vehicles a row belongs to."""

SPEED = ["speed", "sog", "ground_speed", "groundspeed", "velocity", "speed_over_ground"]
HEADING = ["heading", "hdg", "course", "cog", "bearing", "yaw", "course_over_ground", "true_heading", "psi", "theta"]
"""Columns that are recognised, but that a track does not contain: speed along the path, and heading."""

CURVATURE = ["kappa", "curvature", "curv"]

NOT_HEIGHTS = {
    re.sub(r"[\s_.]+", "", name)
    for choices in (
        *COMMON.values(),
        *MORE.values(),
        FLAT_VELOCITY,
        MATRICES,
        UNORDERED,
        DATE_AND_CLOCK,
        WHOLE_AND_NANOSECONDS,
        ANGLED,
    )
    for choice in choices
    for name in choice.split(",")
    if name not in HEIGHTS and name not in ("vz", "vu", "vd", "v_z", "vel_z", "velocity_z", "vel_up", "vel_u")
} | {re.sub(r"[\s_.]+", "", name) for name in (*SPEED, *HEADING, *CURVATURE, *OBJECTS, *_OTHERS.split(","))}
"""Names of columns that are certainly not the height of a position, without separators."""

PREFIXES = {
    *("field", "pose", "msg", "header", "data", "gps", "gnss", "utm", "local", "global", "world", "map", "odom"),
    *("vehicle", "transform", "rigidbody", "timestep", "sim", "ros", "ground", "truth", "gt"),
}
"""Words at the start of column names that do not change the meaning."""

IMPLIED = {
    "itow": "ms",
    "timems": "ms",
    "timeus": "us",
    "timens": "ns",
    "timemin": "min",
    "timeh": "h",
    "utime": "us",
} | {name: name for name in ("milliseconds", "microseconds", "nanoseconds")}
"""Units of columns whose names consist of a time and a unit without a separator, or of a unit alone."""
