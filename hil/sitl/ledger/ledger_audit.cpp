#include "hil/sitl/ledger/ledger_audit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <utility>

#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/ros.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {

std::vector<std::string> transition_gaps(const std::vector<std::string>& blocks) {
  std::map<std::pair<std::string, std::uint64_t>, std::uint64_t> newest;  // by drone and boot
  std::vector<std::string> lost;
  for (const std::string& bytes : blocks) {
    const auto block = fabric::decode_block(bytes);
    if (!block) continue;
    for (const auto& tx : block->transactions) {
      SetCall set;
      if (tx.code != 0 || tx.event_name != contract::set || !set.ParseFromString(tx.event_payload)) continue;
      for (const Asset& asset : set.assets()) {
        const auto slash = asset.id().find("/failsafe");
        if (slash == std::string::npos) continue;
        const auto transitions = transitions_from_cdr(asset.msg_data());
        if (!transitions) {
          lost.push_back(asset.id() + " cannot be read");
          continue;
        }
        for (const Transition& t : *transitions) {
          std::uint64_t& last = newest[{asset.id().substr(0, slash), t.boot_id}];
          if (t.number > last + 1)
            lost.push_back(fmt::format("{}: transition {} after {}", asset.id(), t.number, last));
          last = std::max(last, t.number);
        }
      }
    }
  }
  return lost;
}

std::vector<std::string> not_on_ledger(const SimulatedLedger& ledger, const std::vector<const LedgerPort*>& ports) {
  std::vector<std::string> lost;
  for (const LedgerPort* port : ports) {
    for (const std::string& tx_id : port->acknowledged()) {
      const auto known = ledger.find(tx_id);
      if (!known || known->code != 0) lost.push_back("transaction " + tx_id);
    }
  }
  return lost;
}

}  // namespace ledgerline::hil
