//! The messages of ROS 2 as their definitions have them, independent of what the program uses.

use serde::{Deserialize, Serialize};

macro_rules! message {
    ($($name:ident { $($field:ident: $kind:ty),* $(,)? })*) => {
        $(#[derive(Debug, Clone, Default, Serialize, Deserialize)]
        #[allow(dead_code)]
        pub struct $name { $(pub $field: $kind),* })*
    };
}

/// A matrix of 6 x 6, row by row.
pub type Covariance = [[f64; 6]; 6];

message! {
    Time { sec: i32, nanosec: u32 }
    Header { stamp: Time, frame_id: String }
    Text { data: String }
    Vector3 { x: f64, y: f64, z: f64 }
    Quaternion { x: f64, y: f64, z: f64, w: f64 }
    Pose { position: Vector3, orientation: Quaternion }
    PoseStamped { header: Header, pose: Pose }
    PoseWithCovariance { pose: Pose, covariance: Covariance }
    PoseWithCovarianceStamped { header: Header, pose: PoseWithCovariance }
    Twist { linear: Vector3, angular: Vector3 }
    TwistStamped { header: Header, twist: Twist }
    TwistWithCovariance { twist: Twist, covariance: Covariance }
    Odometry { header: Header, child_frame_id: String, pose: PoseWithCovariance, twist: TwistWithCovariance }
    Transform { translation: Vector3, rotation: Quaternion }
    TransformStamped { header: Header, child_frame_id: String, transform: Transform }
    Frames { transforms: Vec<TransformStamped> }
    JointState { header: Header, name: Vec<String>, position: Vec<f64>, velocity: Vec<f64>, effort: Vec<f64> }
    Clock { clock: Time }
    Image {
        header: Header, height: u32, width: u32, encoding: String, is_bigendian: u8, step: u32, data: Vec<u8>,
    }
    CompressedImage { header: Header, format: String, data: Vec<u8> }
    Region { x_offset: u32, y_offset: u32, height: u32, width: u32, do_rectify: bool }
    CameraInfo {
        header: Header, height: u32, width: u32, distortion_model: String, d: Vec<f64>, k: [f64; 9], r: [f64; 9],
        p: [f64; 12], binning_x: u32, binning_y: u32, roi: Region,
    }
    MapMetaData { map_load_time: Time, resolution: f32, width: u32, height: u32, origin: Pose }
    OccupancyGrid { header: Header, info: MapMetaData, data: Vec<i8> }
    Path { header: Header, poses: Vec<PoseStamped> }
    Duration { sec: i32, nanosec: u32 }
    MeshFile { filename: String, data: Vec<u8> }
    Marker {
        header: Header, ns: String, id: i32, kind: i32, action: i32, pose: Pose, scale: Vector3, color: [f32; 4],
        lifetime: Duration, frame_locked: bool, points: Vec<Vector3>, colors: Vec<[f32; 4]>, texture_resource: String,
        texture: CompressedImage, uv_coordinates: Vec<[f32; 2]>, text: String, mesh_resource: String,
        mesh_file: MeshFile, mesh_use_embedded_materials: bool,
    }
    Markers { markers: Vec<Marker> }
    PointField { name: String, offset: u32, datatype: u8, count: u32 }
    PointCloud2 {
        header: Header, height: u32, width: u32, fields: Vec<PointField>, is_bigendian: bool, point_step: u32,
        row_step: u32, data: Vec<u8>, is_dense: bool,
    }
    KeyValue { key: String, value: String }
    DiagnosticStatus { level: u8, name: String, message: String, hardware_id: String, values: Vec<KeyValue> }
    DiagnosticArray { header: Header, status: Vec<DiagnosticStatus> }
    // What precedes request and reply of a service where ROS 2 runs on Cyclone DDS.
    Caller { client: u64, number: i64 }
    TriggerRequest { caller: Caller, unused: u8 }
    Unnamed { unused: u8 }
    TriggerReply { caller: Caller, success: bool, message: String }
}
