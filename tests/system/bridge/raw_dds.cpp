// What the bridge's DDS side does, without a ledger: hears a topic of any type and says the same bytes on another.
// raw_dds TYPE TOPIC_IN TOPIC_OUT: ends with its standard input, and prints a line of JSON for
// each message then.
#include <fmt/format.h>

#include <cstdio>
#include <iterator>

#include "common/base/log.hpp"
#include "common/dds/dds.hpp"

int main(int argc, char** argv) {
  ledgerline::init_log("raw_dds");
  using namespace ledgerline;
  if (argc != 4) return 2;
  const auto fail = [](const Error& error) {
    fmt::print(stderr, "{}\n", error.message);
    return 1;
  };
  auto participant = dds::Participant::create({.node = "raw_dds"});
  if (!participant) return fail(participant.error());
  const dds::Qos qos{.depth = 1000};
  auto writer = dds::RawWriter::create(*participant, argv[3], argv[1], qos);
  if (!writer) return fail(writer.error());
  std::string lines;
  auto reader = dds::RawReader::create(
      *participant, argv[2], argv[1], qos, [&](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
        const Status said = writer->publish(cdr);
        lines += fmt::format("{{\"cdr\":\"{:02x}\",\"said\":{}}}\n", fmt::join(cdr, ""), said.ok());
      });
  if (!reader) return fail(reader.error());
  fmt::print("{{\"ready\":true}}\n");
  std::fflush(stdout);
  while (std::getchar() != EOF) {
  }
  const auto malformed = reader->refused().malformed, lost = reader->lost();
  { const auto ended = std::move(reader); }  // no message comes any more
  fmt::print("{}{{\"malformed\":{},\"lost\":{}}}\n", lines, malformed, lost);
}
