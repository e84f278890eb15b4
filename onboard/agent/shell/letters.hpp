#pragma once
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/belief/roles.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/mailbox.hpp"
#include "ledgerline.pb.h"

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
/// What the blocks change from then on.
struct FirstRecords {
  std::vector<Control> controls;
  belief::Roles roles;
};
/// The records to begin with, as read after the first block had come, or why they cannot be.
struct RecordsRead {
  Result<FirstRecords> records;
};
using Letter = std::variant<fabric::Block, FrameEnded, StreamState, RecordsRead>;

/// From the ledger client's threads to the main loop: blocks in turn; of the others only few can exist (one frame in
/// flight).
using Mailbox = ledgerline::Mailbox<Letter>;

}  // namespace ledgerline::agent
