#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <mutex>

#include "common/fabric/client/client.hpp"

/// A small client of a Fabric network, or of the embedded node:
///
///     client_example ENDPOINT TLS_CA.pem MSP_ID MSP_DIR VERB, where VERB is
///         submit FUNCTION ARGUMENT...     writes, and waits for the block
///         evaluate FUNCTION ARGUMENT...   asks
///         blocks FIRST COUNT              follows the chain
///         events FIRST COUNT              follows the contract's events
///
/// Channel and contract are LEDGER_CHANNEL and LEDGER_CONTRACT, or `teleop` and `ledgerline`. Exit codes: 0 good, 1 the
/// ledger refused it or was not reached, 2 wrong usage.
namespace {

using namespace ledgerline;
using fabric::Client;

/// What comes on the client's threads is printed there; main waits until it was enough.
class Printer {
 public:
  explicit Printer(std::uint64_t count) : left_(count) {}

  void print(const std::string& line) {
    const std::lock_guard lock(mutex_);
    if (left_ == 0) return;
    std::printf("%s\n", line.c_str());
    --left_;
    changed_.notify_one();
  }
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return left_ == 0; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t left_;
};

void say_connection(bool connected, const std::string& why) {
  if (!connected) std::fprintf(stderr, "not connected, trying again: %s\n", why.c_str());
}

int submit(Client& client, fabric::Call call) {
  const fabric::Outcome outcome = client.submit_and_wait(std::move(call));
  switch (outcome.kind) {
    case fabric::Outcome::Kind::committed:
      std::printf("%s in block %llu: %s\n", outcome.tx_id.c_str(), static_cast<unsigned long long>(outcome.block),
                  outcome.answer.c_str());
      return 0;
    case fabric::Outcome::Kind::invalidated:
      return std::fprintf(stderr, "in its block, but invalid (code %d)\n", outcome.code), 1;
    default:
      return std::fprintf(stderr, "%s\n", outcome.message.c_str()), 1;
  }
}

int evaluate(Client& client, fabric::Call call) {
  const auto answer = client.evaluate(std::move(call));
  if (!answer) return std::fprintf(stderr, "%s\n", answer.error().message.c_str()), 1;
  std::printf("%s\n", answer->c_str());
  return 0;
}

void open_block_stream(Client& client, std::uint64_t first, Printer& printer) {
  Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block& block, std::string_view raw) {
    std::string line = "block " + std::to_string(block.number) + ", " + std::to_string(raw.size()) + " bytes:";
    for (const auto& transaction : block.transactions) {
      line += " " + (transaction.config ? "config" : transaction.tx_id) + "=" + std::to_string(transaction.code);
    }
    printer.print(line);
  };
  handlers.on_connection = say_connection;
  const auto stream = client.blocks(first, std::move(handlers));
  printer.wait();
}

void open_event_stream(Client& client, std::uint64_t first, Printer& printer) {
  const auto on_event = [&](const Client::Event& event) {
    printer.print("event " + event.name + " in block " + std::to_string(event.block) + ": " + event.payload);
  };
  const auto stream = client.events(first, on_event, say_connection);
  printer.wait();
}

std::string from_environment(const char* name, const std::string& otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr ? otherwise : value;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  if (words.size() < 6) return std::fprintf(stderr, "see the head of example.cpp for its arguments\n"), 2;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, words[2], words[3]);
  if (!identity) return std::fprintf(stderr, "%s\n", identity.error().message.c_str()), 1;
  fabric::ClientConfig config;
  config.endpoint = words[0];
  config.tls_ca_file = words[1];
  config.identity = std::move(*identity);
  config.where.channel = from_environment("LEDGER_CHANNEL", config.where.channel);
  config.where.contract = from_environment("LEDGER_CONTRACT", config.where.contract);
  const auto client = Client::create(std::move(config));
  if (!client) return std::fprintf(stderr, "%s\n", client.error().message.c_str()), 1;

  fabric::Call call{words[5], {words.begin() + 6, words.end()}};
  if (words[4] == "submit") return submit(**client, std::move(call));
  if (words[4] == "evaluate") return evaluate(**client, std::move(call));
  if (words.size() != 7) return std::fprintf(stderr, "blocks and events take FIRST and COUNT\n"), 2;
  const std::uint64_t first = std::strtoull(words[5].c_str(), nullptr, 10);
  Printer printer(std::strtoull(words[6].c_str(), nullptr, 10));
  if (words[4] == "blocks") return open_block_stream(**client, first, printer), 0;
  if (words[4] == "events") return open_event_stream(**client, first, printer), 0;
  return std::fprintf(stderr, "unknown verb %s\n", words[4].c_str()), 2;
}
