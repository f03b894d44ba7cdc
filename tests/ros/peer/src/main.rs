//! An independent ROS 2 client for the tests, on ros2-client and RustDDS.
//!
//!     peer offers SECONDS                  prints type and quality of service of each topic, as lines of JSON
//!     peer hear SECONDS NAMESPACE          subscribes to all topics, and prints one line of JSON for each at the end
//!     peer drive SECONDS TOPIC V W [stamped]   sends velocities, 20 a second
//!     peer call SECONDS SERVICE            calls a std_srvs/Trigger, and prints its reply
//!     peer ask SECONDS SERVICE             the same as a ROS 2 on Fast DDS asks, which gets no reply
//!     peer say SECONDS TOPIC TEXT          sends a std_msgs/String once somebody listens

mod digest;
mod messages;

use std::collections::HashMap;
use std::time::{Duration, Instant};

use digest::Digest;
use messages::*;
use ros2_client::ros2::{policy, QosPolicies, QosPolicyBuilder};
use ros2_client::rustdds::TopicKind;
use ros2_client::{Context, ContextOptions, MessageTypeName, Name, Node, NodeName, NodeOptions};
use serde::de::DeserializeOwned;

const LOOK: Duration = Duration::from_millis(2);

/// What was heard on a topic.
#[derive(Default)]
struct Heard {
    count: usize,
    frame: String,
    first: String,
    last: String,
    wrong: String,
}

/// Takes what has come; gives what was heard so far.
type Listener = Box<dyn FnMut() -> String>;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let word = |place: usize| words.get(place).cloned().unwrap_or_default();
    let number = |place: usize| word(place).parse::<f64>().expect("a number");
    let within = Duration::from_secs_f64(number(1));
    let domain = std::env::var("ROS_DOMAIN_ID")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(0);
    let context = Context::with_options(ContextOptions::new().domain_id(domain)).expect("a domain");
    let node = || {
        let name = NodeName::new("/", "peer").expect("a name");
        context
            .new_node(name, NodeOptions::new().enable_rosout(false))
            .expect("a node")
    };
    match word(0).as_str() {
        "offers" => offers(&context, within),
        "hear" => hear(node(), within, &word(2)),
        "drive" => drive(node(), within, &word(2), number(3), number(4), word(5) == "stamped"),
        "call" => call(&context, within, &word(2)),
        "ask" => ask(&context, within, &word(2)),
        "say" => say(node(), within, &word(2), &word(3)),
        other => panic!("'{other}' is no command"),
    }
}

/// A quality of service that asks for all that a publisher is to offer.
fn asked(latched: bool) -> QosPolicies {
    let durability = if latched {
        policy::Durability::TransientLocal
    } else {
        policy::Durability::Volatile
    };
    QosPolicyBuilder::new()
        .reliability(policy::Reliability::Reliable {
            max_blocking_time: ros2_client::ros2::Duration::from_millis(100),
        })
        .durability(durability)
        .history(policy::History::KeepLast { depth: 10 })
        .build()
}

fn topic_of(node: &Node, name: &str, kind: &str, qos: &QosPolicies) -> ros2_client::rustdds::Topic {
    let (package, leaf) = kind.split_once('/').expect("a type");
    let name = Name::parse(name).expect("a name");
    node.create_topic(&name, MessageTypeName::new(package, leaf), qos)
        .expect("a topic")
}

fn listener<M>(node: &mut Node, name: &str, kind: &str, latched: bool, read: fn(&M) -> Digest) -> Listener
where
    M: 'static + DeserializeOwned,
{
    let qos = asked(latched);
    let topic = topic_of(node, name, kind, &qos);
    let subscription = node
        .create_subscription::<M>(&topic, Some(qos))
        .expect("a subscription");
    let mut heard = Heard::default();
    Box::new(move || {
        loop {
            match subscription.take() {
                Ok(Some((message, _))) => match read(&message) {
                    Ok((frame, content)) => {
                        if heard.count == 0 {
                            heard.first = content.clone();
                        }
                        heard.count += 1;
                        (heard.frame, heard.last) = (frame, content);
                    }
                    Err(wrong) => heard.wrong = wrong,
                },
                Ok(None) => break,
                Err(err) => {
                    heard.wrong = format!("{err:?}");
                    break;
                }
            }
        }
        format!(
            "\"count\": {}, \"frame\": {:?}, \"first\": {:?}, \"last\": {:?}, \"wrong\": {:?}",
            heard.count, heard.frame, heard.first, heard.last, heard.wrong
        )
    })
}

fn hear(mut node: Node, within: Duration, namespace: &str) {
    let below = |name: &str| {
        if namespace.is_empty() {
            format!("/{name}")
        } else {
            format!("/{namespace}/{name}")
        }
    };
    let mut listeners: Vec<(String, Listener)> = vec![];
    macro_rules! listen {
        ($name:expr, $kind:literal, $latched:expr, $read:path) => {
            let name: String = $name;
            listeners.push((name.clone(), listener(&mut node, &name, $kind, $latched, $read)));
        };
    }
    for camera in ["color", "depth"] {
        listen!(
            below(&format!("camera/{camera}/image_raw")),
            "sensor_msgs/Image",
            false,
            digest::image
        );
        listen!(
            below(&format!("camera/{camera}/camera_info")),
            "sensor_msgs/CameraInfo",
            false,
            digest::camera_info
        );
    }
    listen!(below("odom"), "nav_msgs/Odometry", false, digest::odometry);
    listen!(below("ground_truth/odom"), "nav_msgs/Odometry", false, digest::odometry);
    listen!(below("tf"), "tf2_msgs/TFMessage", false, digest::frames);
    listen!(below("tf_static"), "tf2_msgs/TFMessage", true, digest::frames);
    listen!(below("joint_states"), "sensor_msgs/JointState", false, digest::joints);
    listen!("/clock".to_owned(), "rosgraph_msgs/Clock", false, digest::clock);
    listen!(below("map"), "nav_msgs/OccupancyGrid", true, digest::grid);
    listen!(below("plan"), "nav_msgs/Path", true, digest::path);
    listen!(
        below("explore/markers"),
        "visualization_msgs/MarkerArray",
        true,
        digest::markers
    );
    listen!(below("explore/surface"), "sensor_msgs/PointCloud2", true, digest::cloud);
    listen!(
        below("pose"),
        "geometry_msgs/PoseWithCovarianceStamped",
        false,
        digest::pose
    );
    listen!(
        "/diagnostics".to_owned(),
        "diagnostic_msgs/DiagnosticArray",
        false,
        digest::diagnostics
    );
    listen!(below("cmd_vel"), "geometry_msgs/Twist", false, digest::twist);

    let end = Instant::now() + within;
    while Instant::now() < end {
        for (_, take) in &mut listeners {
            take();
        }
        std::thread::sleep(LOOK);
    }
    for (name, take) in &mut listeners {
        println!("{{\"topic\": {name:?}, {}}}", take());
    }
}

/// Type and quality of service of the topics of others, as long as this program has none of its own.
fn offers(context: &Context, within: Duration) {
    std::thread::sleep(within);
    let mut found: HashMap<String, (String, bool, bool)> = HashMap::new();
    for one in context.domain_participant().discovered_topics() {
        let topic = one.topic_data;
        let name = topic.name.trim_start_matches("rt").to_owned();
        let there = found.entry(name).or_insert((topic.type_name, false, false));
        // What subscribers ask for is never more than what is offered.
        there.1 |= matches!(topic.reliability, Some(policy::Reliability::Reliable { .. }));
        there.2 |= matches!(topic.durability, Some(policy::Durability::TransientLocal));
    }
    for (name, (kind, reliable, latched)) in found {
        println!("{{\"topic\": {name:?}, \"type\": {kind:?}, \"reliable\": {reliable}, \"latched\": {latched}}}");
    }
}

fn drive(mut node: Node, within: Duration, name: &str, forward: f64, turn: f64, stamped: bool) {
    let qos = asked(false);
    let topic = topic_of(
        &node,
        name,
        if stamped {
            "geometry_msgs/TwistStamped"
        } else {
            "geometry_msgs/Twist"
        },
        &qos,
    );
    let twist = Twist {
        linear: Vector3 {
            x: forward,
            ..Default::default()
        },
        angular: Vector3 {
            z: turn,
            ..Default::default()
        },
    };
    let end = Instant::now() + within;
    let plain = (!stamped).then(|| {
        node.create_publisher::<Twist>(&topic, Some(qos.clone()))
            .expect("a publisher")
    });
    let other = stamped.then(|| {
        node.create_publisher::<TwistStamped>(&topic, Some(qos))
            .expect("a publisher")
    });
    while Instant::now() < end {
        if let Some(to) = &plain {
            to.publish(twist.clone()).expect("published");
        }
        if let Some(to) = &other {
            to.publish(TwistStamped {
                header: Header::default(),
                twist: twist.clone(),
            })
            .expect("published");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn trigger_topic(context: &Context, name: String, part: &str) -> ros2_client::rustdds::Topic {
    let kind = format!("std_srvs::srv::dds_::Trigger_{part}_");
    context
        .domain_participant()
        .create_topic(name, kind, &asked(false), TopicKind::NoKey)
        .expect("a topic")
}

/// The caller is not in the request, but beside it.
fn ask(context: &Context, within: Duration, service: &str) {
    let requests = trigger_topic(context, format!("rq{service}Request"), "Request");
    let to = context
        .domain_participant()
        .create_publisher(&asked(false))
        .expect("a publisher");
    let to = to
        .create_datawriter_no_key_cdr::<Unnamed>(&requests, None)
        .expect("a writer");
    let end = Instant::now() + within;
    while Instant::now() < end {
        std::thread::sleep(Duration::from_secs(1));
        to.write(Unnamed { unused: 0 }, None).expect("sent");
    }
}

/// The request is repeated, for nobody tells whether both topics of the service have been found.
fn call(context: &Context, within: Duration, service: &str) {
    let participant = context.domain_participant();
    let qos = asked(false);
    let requests = trigger_topic(context, format!("rq{service}Request"), "Request");
    let replies = trigger_topic(context, format!("rr{service}Reply"), "Response");
    let from = participant.create_subscriber(&qos).expect("a subscriber");
    let mut from = from
        .create_datareader_no_key_cdr::<TriggerReply>(&replies, None)
        .expect("a reader");
    let to = participant.create_publisher(&qos).expect("a publisher");
    let to = to
        .create_datawriter_no_key_cdr::<TriggerRequest>(&requests, None)
        .expect("a writer");
    let (end, mut next, mut number) = (Instant::now() + within, Instant::now(), 0);
    let client = 0x0123_4567_89ab_cdef;
    while Instant::now() < end {
        if Instant::now() >= next {
            number += 1;
            next += Duration::from_secs(1);
            to.write(
                TriggerRequest {
                    caller: Caller { client, number },
                    unused: 0,
                },
                None,
            )
            .expect("sent");
        }
        while let Ok(Some(sample)) = from.take_next_sample() {
            let reply = sample.into_value();
            if reply.caller.client == client && (1..=number).contains(&reply.caller.number) {
                println!("{{\"success\": {}, \"message\": {:?}}}", reply.success, reply.message);
                return;
            }
        }
        std::thread::sleep(LOOK);
    }
    eprintln!("{service} does not reply.");
    std::process::exit(1);
}

fn say(mut node: Node, within: Duration, name: &str, text: &str) {
    let qos = asked(false);
    let topic = topic_of(&node, name, "std_msgs/String", &qos);
    let to = node.create_publisher::<Text>(&topic, Some(qos)).expect("a publisher");
    let end = Instant::now() + within;
    while Instant::now() < end {
        to.publish(Text { data: text.to_owned() }).expect("published");
        std::thread::sleep(Duration::from_millis(300));
    }
}
