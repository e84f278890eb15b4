//! A pilot who knows ROS 2's messages and a drone's name, nothing else.

use crate::{qos, say};
use futures::{future, pin_mut, StreamExt};
use ros2_client::{MessageTypeName, Name, Node, Publisher, Subscription};
use serde::{de::DeserializeOwned, Deserialize, Serialize};
use smol::Timer;
use std::cell::Cell;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const TIMEOUT: Duration = Duration::from_secs(60); // no limit on speed: only how long a broken flight may take

#[derive(Debug, Serialize)]
struct Empty {
    structure_needs_at_least_one_member: u8,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Vector3 {
    x: f64,
    y: f64,
    z: f64,
}

const ZERO: Vector3 = Vector3 { x: 0.0, y: 0.0, z: 0.0 };

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Twist {
    linear: Vector3,
    angular: Vector3,
}

#[derive(Deserialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Deserialize)]
struct Pose {
    position: Vector3,
    orientation: Quaternion,
}

#[derive(Deserialize)]
struct WithCovariance<T> {
    value: T,
    _covariance: [[f64; 6]; 6], // 36 in a row on the wire
}

#[derive(Deserialize)]
struct Header {
    sec: i32,
    nanosec: u32,
    frame_id: String,
}

#[derive(Deserialize)]
struct Odometry {
    header: Header,
    child_frame_id: String,
    pose: WithCovariance<Pose>,
    twist: WithCovariance<Twist>,
}

fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).expect("a clock after 1970").as_secs_f64()
}

fn say_begin(what: &str) {
    say(&format!(r#"{{"begin":"{what}","at_s":{:.6}}}"#, now_s()));
}

fn say_odometry(o: &Odometry) {
    let (p, q) = (o.pose.value.position, &o.pose.value.orientation);
    say(&format!(
        r#"{{"stamp_s":{}.{:09},"frame":"{}","child":"{}","position":[{},{},{}],"orientation":[{},{},{},{}]}}"#,
        o.header.sec, o.header.nanosec, o.header.frame_id, o.child_frame_id, p.x, p.y, p.z, q.x, q.y, q.z, q.w
    ));
}

fn publisher<M: Serialize>(node: &mut Node, name: &str, package: &str, kind: &str) -> Publisher<M> {
    let topic = node.create_topic(&Name::parse(name).expect("topic"), MessageTypeName::new(package, kind), &qos());
    node.create_publisher(&topic.expect("topic"), None).expect("publisher")
}

fn subscription<M: DeserializeOwned + 'static>(node: &mut Node, name: &str, package: &str, kind: &str) -> Subscription<M> {
    let topic = node.create_topic(&Name::parse(name).expect("topic"), MessageTypeName::new(package, kind), &qos());
    node.create_subscription(&topic.expect("topic"), None).expect("subscription")
}

/// Whether it came to hold within that time.
async fn until(holds: impl Fn() -> bool, timeout: Duration) -> bool {
    let end = Instant::now() + timeout;
    while !holds() {
        if Instant::now() > end {
            return false;
        }
        Timer::after(Duration::from_millis(20)).await;
    }
    true
}

/// Again where nothing happens, as people do: a reader that found us late has heard nothing of the first time.
async fn press(button: &Publisher<Empty>, word: &str, done: impl Fn() -> bool) {
    for _ in 0..5 {
        button.async_publish(Empty { structure_needs_at_least_one_member: 0 }).await.expect("publish");
        if until(&done, Duration::from_secs(12)).await {
            return;
        }
        say(&format!(r#"{{"unanswered":"{word}"}}"#));
    }
    panic!("no answer to {word}");
}

pub async fn fly(node: &mut Node, drone: &str, forward_mps: f64, flying: Duration) {
    let takeoff = publisher::<Empty>(node, &format!("/{drone}/takeoff"), "std_msgs", "Empty");
    let land = publisher::<Empty>(node, &format!("/{drone}/land"), "std_msgs", "Empty");
    let cmd_vel = publisher::<Twist>(node, &format!("/{drone}/cmd_vel"), "geometry_msgs", "Twist");
    let odometry = subscription::<Odometry>(node, &format!("/{drone}/odom"), "nav_msgs", "Odometry");
    let newest = Cell::new((0.0, 0.0)); // height, m, and climb, m/s

    let hear = async {
        let messages = odometry.async_stream();
        pin_mut!(messages);
        while let Some(message) = messages.next().await {
            let (o, _) = message.expect("message");
            newest.set((o.pose.value.position.z, o.twist.value.linear.z));
            say_odometry(&o);
        }
    };
    let height = || newest.get().0;
    let pilot = async {
        // wait_for_subscription() would wait for ever where the reader was found between its look and its listening, and
        // events of a busy node are dropped: who is not found by then is pressed for all the same.
        let found = || {
            let buttons = [&takeoff, &land].iter().all(|button| button.get_subscription_count(node) > 0);
            buttons && cmd_vel.get_subscription_count(node) > 0
        };
        if !until(found, Duration::from_secs(20)).await {
            say(r#"{"unanswered":"discovery"}"#);
        }
        Timer::after(Duration::from_secs(1)).await; // they have yet to find us, and hear nothing from before that
        say_begin("takeoff");
        press(&takeoff, "takeoff", || height() > 0.15).await;
        assert!(until(|| height() > 0.5 && newest.get().1.abs() < 0.05, TIMEOUT).await, "no hover");

        say_begin("cmd_vel");
        let ahead = Twist { linear: Vector3 { x: forward_mps, ..ZERO }, angular: ZERO };
        for _ in 0..flying.as_millis() / 100 {
            cmd_vel.async_publish(ahead).await.expect("publish");
            Timer::after(Duration::from_millis(100)).await;
        }
        say_begin("silence");
        Timer::after(Duration::from_secs(3)).await;
        say_begin("land");
        press(&land, "land", || height() < 0.15).await;
    };
    pin_mut!(hear, pilot);
    future::select(pilot, hear).await;
    say(r#"{"landed":true}"#);
}
