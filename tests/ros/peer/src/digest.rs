//! What a message says, in short, after a check of what its definition demands of it.

use crate::messages::*;

/// The frame of a message, and its content in short; an error says what is wrong with it.
pub type Digest = Result<(String, String), String>;

pub fn image(one: &Image) -> Digest {
    let bytes = match one.encoding.as_str() {
        "rgb8" => 3,
        "32FC1" => 4,
        "16UC1" => 2,
        other => return Err(format!("encoding {other}")),
    };
    require(one.step == one.width * bytes, "step")?;
    require(one.data.len() == (one.step * one.height) as usize, "size of the data")?;
    let depths = || {
        one.data
            .chunks(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
    };
    let middle = if bytes == 4 {
        let mut finite: Vec<f32> = depths().filter(|depth| depth.is_finite()).collect();
        require(finite.iter().all(|depth| *depth > 0.0), "depth that is not positive")?;
        finite.sort_by(f32::total_cmp);
        finite.get(finite.len() / 2).copied().unwrap_or(f32::NAN)
    } else {
        one.data.iter().map(|byte| f32::from(*byte)).sum::<f32>() / one.data.len() as f32
    };
    said(
        &one.header,
        format!("{} {}x{} {middle:.3}", one.encoding, one.width, one.height),
    )
}

pub fn camera_info(one: &CameraInfo) -> Digest {
    require(one.k[0] > 0.0 && one.k[8] == 1.0, "k")?;
    require(one.p[0] == one.k[0] && one.p[2] == one.k[2] && one.p[10] == 1.0, "p")?;
    require(one.r == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "r")?;
    said(
        &one.header,
        format!("{} {}x{} {:.3}", one.distortion_model, one.width, one.height, one.k[2]),
    )
}

pub fn odometry(one: &Odometry) -> Digest {
    unit(&one.pose.pose.orientation)?;
    let (at, speed) = (&one.pose.pose.position, one.twist.twist.linear.x);
    said(
        &one.header,
        format!("{} {:.4} {:.4} {:.4}", one.child_frame_id, at.x, at.y, speed),
    )
}

pub fn frames(one: &Frames) -> Digest {
    let mut links = vec![];
    for link in &one.transforms {
        unit(&link.transform.rotation)?;
        links.push(format!("{}>{}", link.header.frame_id, link.child_frame_id));
    }
    Ok((
        one.transforms.first().ok_or("no transform")?.header.frame_id.clone(),
        links.join(" "),
    ))
}

pub fn joints(one: &JointState) -> Digest {
    require(
        one.name.len() == one.position.len() && one.name.len() == one.velocity.len(),
        "lengths",
    )?;
    said(&one.header, one.name.join(" "))
}

pub fn clock(one: &Clock) -> Digest {
    Ok((String::new(), format!("{:.3}", seconds(&one.clock))))
}

pub fn grid(one: &OccupancyGrid) -> Digest {
    require(
        one.data.len() == (one.info.width * one.info.height) as usize,
        "size of the data",
    )?;
    require(one.data.iter().all(|cell| (-1..=100).contains(cell)), "values")?;
    unit(&one.info.origin.orientation)?;
    let free = one.data.iter().filter(|cell| **cell == 0).count();
    said(&one.header, format!("{:.3} {free}", one.info.resolution))
}

pub fn path(one: &Path) -> Digest {
    require(
        one.poses.iter().all(|pose| pose.header.frame_id == one.header.frame_id),
        "frames",
    )?;
    said(&one.header, format!("{}", one.poses.len()))
}

pub fn markers(one: &Markers) -> Digest {
    for marker in &one.markers {
        unit(&marker.pose.orientation)?;
        require(
            marker.action == 2 || marker.kind != 5 || marker.points.len() % 2 == 0,
            "ends of lines",
        )?;
        require(
            marker.scale.x > 0.0 && marker.color[3] > 0.0,
            "a marker that cannot be seen",
        )?;
    }
    let names: Vec<&str> = one.markers.iter().map(|marker| marker.ns.as_str()).collect();
    said(&one.markers.first().ok_or("no marker")?.header, names.join(" "))
}

pub fn cloud(one: &PointCloud2) -> Digest {
    require(one.row_step == one.width * one.point_step, "row_step")?;
    require(
        one.data.len() == (one.row_step * one.height) as usize,
        "size of the data",
    )?;
    let names: Vec<&str> = one.fields.iter().map(|field| field.name.as_str()).collect();
    said(&one.header, format!("{} {}", names.join(","), one.width * one.height))
}

pub fn pose(one: &PoseWithCovarianceStamped) -> Digest {
    unit(&one.pose.pose.orientation)?;
    let at = &one.pose.pose.position;
    said(&one.header, format!("{:.4} {:.4}", at.x, at.y))
}

pub fn diagnostics(one: &DiagnosticArray) -> Digest {
    let status = one.status.first().ok_or("no status")?;
    let keys: Vec<&str> = status.values.iter().map(|pair| pair.key.as_str()).collect();
    said(
        &one.header,
        format!("{} {} {}", status.name, status.level, keys.join(",")),
    )
}

pub fn twist(one: &Twist) -> Digest {
    require(
        one.linear.y == 0.0 && one.linear.z == 0.0 && one.angular.x == 0.0 && one.angular.y == 0.0,
        "axes",
    )?;
    Ok((String::new(), format!("{:.3} {:.3}", one.linear.x, one.angular.z)))
}

fn said(header: &Header, content: String) -> Digest {
    require(header.stamp.nanosec < 1_000_000_000, "stamp")?;
    Ok((header.frame_id.clone(), content))
}

fn seconds(time: &Time) -> f64 {
    f64::from(time.sec) + 1e-9 * f64::from(time.nanosec)
}

fn unit(one: &Quaternion) -> Result<(), String> {
    let squares = one.x * one.x + one.y * one.y + one.z * one.z + one.w * one.w;
    require((squares - 1.0).abs() < 1e-6, "a quaternion that is not of length 1")
}

fn require(is_so: bool, what: &str) -> Result<(), String> {
    if is_so {
        Ok(())
    } else {
        Err(what.to_owned())
    }
}
