#pragma once
#include <cstdint>
#include <string>
#include <variant>

#include "common/fabric/client/client.hpp"
#include "common/rt/mailbox.hpp"
#include "onboard/agent/core/records.hpp"

namespace ledgerline::agent {

/// How a submitted frame ended.
struct FrameEnded {
  std::uint64_t frame = 0;
  fabric::Outcome outcome;
};
/// The block stream came up or broke.
struct StreamState {
  bool connected = false;
  std::string why;
};
/// The chain goes on behind the checkpoint.
struct Continued {
  fabric::Continuation how;
};
/// The records to begin with, as read after the first block had come, or why they cannot be.
struct RecordsRead {
  Result<FirstRecords> records;
};
/// The roles of organisations that a record has named since, or why they cannot be read yet.
struct RolesRead {
  verification::Organisations organisations;
  Result<verification::Roles> roles;
};
/// The records as another organisation's peer reports them, or why it does not.
struct SecondReading {
  Result<FirstRecords> records;
};
/// A block that was taken as it was ordered is the own peer's, too. Of those that are not there are few.
struct Confirmed {
  std::uint64_t number = 0;
  std::string hash;
};
/// A stream of blocks contradicts what is known of the channel.
struct Contradiction {
  std::string what;
};
/// A block that a stream refused: its stops count all the same.
struct RefusedBlock {
  fabric::Block block;
};
using Event = std::variant<fabric::Block, RefusedBlock, FrameEnded, StreamState, Continued, RecordsRead, RolesRead,
                           SecondReading, Contradiction, Confirmed>;

/// From the ledger client's threads to the main loop: blocks in turn; of the others only few can exist (one frame in
/// flight; a contradiction for each attempt of the stream, which backs off).
using Mailbox = ledgerline::Mailbox<Event>;

}  // namespace ledgerline::agent
