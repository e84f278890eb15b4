//! A ROS 2 node in Rust that knows nothing of this project: publishes or hears messages of a made-up type, lists the
//! nodes of its domain (ROS_DOMAIN_ID), or flies a drone by its topics. Says what happens as lines of JSON; what a message
//! is for a number is said in made_up.py, and here again.
//!
//! publish sends the message for 0 repeatedly until a line comes on its standard input.
//! fly takes off, flies ahead, is silent for 3 s, lands, and ends. Its lines: each odometry heard, and each first word of
//! its own with the (real) time; the last one is {"landed":true}.
//!
//! ros2-client-peer publish TOPIC FIRST COUNT PERIOD_MS | subscribe TOPIC COUNT | nodes NAME | fly DRONE FORWARD_MPS SECONDS

mod fly;

use futures::{pin_mut, StreamExt};
use ros2_client::{Context, ContextOptions, MessageTypeName, Name, Node, NodeEvent, NodeName, NodeOptions};
use ros2_client::ros2::{policy, Duration, QosPolicies, QosPolicyBuilder};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

#[derive(Debug, Serialize, Deserialize)]
struct Inner {
    small: i16,
    text: String,
    raw: Vec<u8>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Nested {
    number: u32,
    name: String,
    fixed: [f64; 3],
    words: Vec<String>,
    inners: Vec<Inner>,
    pair: [Inner; 2],
}

fn inner(n: u32, k: u32) -> Inner {
    Inner {
        small: ((n + k) % 1000) as i16 - 500,
        text: "x".repeat(((n + k) % 17) as usize),
        raw: (0..(7 * n + k) % 23).map(|i| ((n + k + i) % 256) as u8).collect(),
    }
}

fn message(n: u32) -> Nested {
    let f = f64::from(n);
    Nested {
        number: n,
        name: format!("message {n}"),
        fixed: [f, f / 2.0, -f / 4.0],
        words: (0..n % 5).map(|k| format!("word {k}")).collect(),
        inners: (0..n % 4).map(|k| inner(n, k)).collect(),
        pair: [inner(n, 10), inner(n, 11)],
    }
}

fn qos() -> QosPolicies {
    QosPolicyBuilder::new()
        .history(policy::History::KeepLast { depth: 1000 })
        .reliability(policy::Reliability::Reliable { max_blocking_time: Duration::from_millis(1000) })
        .durability(policy::Durability::Volatile)
        .build()
}

fn say(line: &str) {
    println!("{line}");
    std::io::stdout().flush().expect("stdout");
}

async fn publish(node: &mut Node, topic: &Name, first: u32, count: u32, period: std::time::Duration) {
    let topic = node.create_topic(topic, MessageTypeName::new("made_up_msgs", "Nested"), &qos()).expect("topic");
    let publisher = node.create_publisher::<Nested>(&topic, None).expect("publisher");
    let go = Arc::new(AtomicBool::new(false));
    let released = go.clone();
    std::thread::spawn(move || {
        std::io::stdin().read_line(&mut String::new()).expect("stdin");
        released.store(true, Ordering::Relaxed);
    });
    // That one side knows the other does not mean that the other knows it.
    while !go.load(Ordering::Relaxed) {
        publisher.async_publish(message(0)).await.expect("publish");
        smol::Timer::after(std::time::Duration::from_millis(100)).await;
    }
    for number in first..first + count {
        publisher.async_publish(message(number)).await.expect("publish");
        smol::Timer::after(period).await;
    }
    say(&format!(r#"{{"published":{count}}}"#));
    // Until it is ended: a reliable writer may have to send again.
    std::future::pending::<()>().await;
}

async fn subscribe(node: &mut Node, topic: &Name, count: u32) {
    let topic = node.create_topic(topic, MessageTypeName::new("made_up_msgs", "Nested"), &qos()).expect("topic");
    let subscription = node.create_subscription::<Nested>(&topic, None).expect("subscription");
    say(r#"{"ready":true}"#);
    let messages = subscription.async_stream();
    pin_mut!(messages);
    let mut left = count;
    while left > 0 {
        let (got, _) = messages.next().await.expect("a stream that does not end").expect("message");
        // Values as they were understood, written again: a message has one CDR.
        let body = cdr_encoding::to_vec::<_, byteorder::LittleEndian>(&got).expect("CDR");
        let hex: String = body.iter().map(|b| format!("{b:02x}")).collect();
        say(&format!(r#"{{"number":{},"cdr":"00010000{hex}"}}"#, got.number));
        left -= u32::from(got.number > 0);
    }
}

async fn nodes(node: &mut Node, wanted: &str) {
    let events = node.status_receiver();
    say(r#"{"ready":true}"#);
    pin_mut!(events);
    while let Some(event) = events.next().await {
        if let NodeEvent::ROS(participant) = event {
            for found in participant.nodes() {
                say(&format!(r#"{{"node":"{}"}}"#, found.fully_qualified_name()));
                if found.fully_qualified_name() == wanted {
                    return;
                }
            }
        }
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let text = |i: usize| arguments.get(i).expect("see the first lines of main.rs").as_str();
    let number = |i: usize| text(i).parse::<u32>().expect("a number");
    let domain = std::env::var("ROS_DOMAIN_ID").map_or(0, |d| d.parse().expect("ROS_DOMAIN_ID"));
    let context = Context::with_options(ContextOptions::new().domain_id(domain)).expect("context");
    let name = NodeName::new("/", "ros2_client_peer").expect("name");
    let mut node = context.new_node(name, NodeOptions::new().enable_rosout(false)).expect("node");
    smol::spawn(node.spinner().expect("spinner").spin()).detach();
    let topic = |i: usize| Name::parse(text(i)).expect("topic");
    smol::block_on(async {
        match text(0) {
            "publish" => {
                let period = std::time::Duration::from_millis(number(4).into());
                publish(&mut node, &topic(1), number(2), number(3), period).await
            }
            "subscribe" => subscribe(&mut node, &topic(1), number(2)).await,
            "nodes" => nodes(&mut node, text(1)).await,
            "fly" => {
                let real = |i: usize| text(i).parse::<f64>().expect("a number");
                fly::fly(&mut node, text(1), real(2), std::time::Duration::from_secs_f64(real(3))).await
            }
            other => panic!("no such job: {other}"),
        }
    });
}
