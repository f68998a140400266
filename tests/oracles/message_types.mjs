// Definitions of the messages that bags are made of, as ROS 2 has them (the concatenated text of MCAP's `ros2msg`).
const LINE = '\n================================================================================\n';
const HEADER = `${LINE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id`;
const TIME = `${LINE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec`;
const POINT = `${LINE}MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z`;
const VECTOR = `${LINE}MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z`;
const QUATERNION = `${LINE}MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w`;
const POSE = `${LINE}MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation`;

export const DEFINITIONS = {
  'sensor_msgs/msg/PointCloud2':
    'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n' +
    'uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense' +
    `${LINE}MSG: sensor_msgs/PointField\nstring name\nuint32 offset\nuint8 datatype\nuint32 count${HEADER}${TIME}`,
  'nav_msgs/msg/Odometry':
    'std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n' +
    'geometry_msgs/TwistWithCovariance twist' +
    `${LINE}MSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance` +
    `${LINE}MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance` +
    `${LINE}MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular` +
    POSE + POINT + QUATERNION + VECTOR + HEADER + TIME,
  'geometry_msgs/msg/PoseStamped':
    `std_msgs/Header header\ngeometry_msgs/Pose pose${POSE}${POINT}${QUATERNION}${HEADER}${TIME}`,
  'tf2_msgs/msg/TFMessage':
    'geometry_msgs/TransformStamped[] transforms' +
    `${LINE}MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n` +
    `geometry_msgs/Transform transform` +
    `${LINE}MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation` +
    VECTOR + QUATERNION + HEADER + TIME,
  'sensor_msgs/msg/NavSatFix':
    'std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n' +
    'float64[9] position_covariance\nuint8 position_covariance_type' +
    `${LINE}MSG: sensor_msgs/NavSatStatus\nint8 status\nuint16 service${HEADER}${TIME}`,
  'livox_ros_driver2/msg/CustomMsg':
    'std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n' +
    'livox_ros_driver2/CustomPoint[] points' +
    `${LINE}MSG: livox_ros_driver2/CustomPoint\nuint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n` +
    `uint8 reflectivity\nuint8 tag\nuint8 line${HEADER}${TIME}`,
  'velodyne_msgs/msg/VelodyneScan':
    'std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets' +
    `${LINE}MSG: velodyne_msgs/VelodynePacket\nbuiltin_interfaces/Time stamp\nuint8[1206] data${HEADER}${TIME}`,
  'ouster_sensor_msgs/msg/PacketMsg': 'uint8[] buf',
  'std_msgs/msg/String': 'string data',
  'sensor_msgs/msg/Imu':
    'std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n' +
    'geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n' +
    'geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance' +
    QUATERNION + VECTOR + HEADER + TIME,
};
