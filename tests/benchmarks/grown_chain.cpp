#include "tests/benchmarks/grown_chain.hpp"

#include <fmt/format.h>

#include <condition_variable>
#include <cstdlib>
#include <mutex>

#include "chaincode/node/shell/node.hpp"

namespace ledgerline::grown {

fabric::Call state_of_a_drone() {
  const std::string data(936, 'A');  // base64 of 702 bytes, as an odometry message has
  return {"set", {R"({"assets":[{"id":"tello1/odom","msgType":"t","msgData":")" + data + R"("}],"stream":true})"}};
}

crypto::SigningIdentity user_of(const std::string& dir) {
  return crypto::load_identity(crypto::Library::libcrypto, "Org1MSP",
                               dir + organisation + "/users/User1@org1.ledgerline/msp")
      .value();
}

void give_up(const std::string& why) {
  fmt::print(stderr, "{}\n", why);
  std::exit(1);
}

std::uint64_t grow(const std::string& dir, std::uint64_t height) {
  auto node = node::Node::open({dir, {}});
  if (!node) give_up(node.error().message);
  const crypto::SigningIdentity user = user_of(dir);
  std::mutex mutex;
  std::condition_variable done;
  std::uint64_t waiting = 0;
  (*node)->on_answer([&](std::uint64_t, const node::TxStatus&) {
    const std::lock_guard lock(mutex);
    --waiting;
    done.notify_one();
  });
  for (std::uint64_t number = (*node)->feed().height(); number < height; ++number) {
    const auto proposal = *fabric::make_proposal(user, {}, state_of_a_drone(), realtime_ns(), crypto::random_bytes(24));
    {
      std::unique_lock lock(mutex);
      done.wait(lock, [&] { return waiting < 32; });
      ++waiting;
    }
    (*node)->post_always([&user, proposal](node::NodeCore& core) {
      const node::Now now{monotonic_ns(), realtime_ns()};
      const node::Reply endorsed = core.endorse(proposal.signed_proposal, now);
      if (endorsed.code != node::Code::ok) give_up(endorsed.message + endorsed.detail);
      core.watch(proposal.tx_id, 1);
      core.order(*fabric::sign_envelope(user, endorsed.bytes), now);
    });
  }
  std::unique_lock lock(mutex);
  done.wait(lock, [&] { return waiting == 0; });
  return (*node)->feed().height();
}

}  // namespace ledgerline::grown
