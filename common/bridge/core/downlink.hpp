#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/bridge/core/rules.hpp"
#include "common/bridge/core/set_call.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/histogram.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::bridge {

/// Why a message of the ledger was not published.
enum class Refusal : std::uint8_t {
  echo,          ///< our own
  repeated,      ///< the newest one again, which a batch carries along
  duplicate,     ///< older than the newest of its writer
  wrong_writer,  ///< an id of an organisation, by a member of another
  unverified,    ///< the writer's certificate or signature is not good
  wrong_type,    ///< not that of its [[topic]], or of another id with the same topic; or no type of ROS 2
  malformed,     ///< no CDR of ROS 2
  too_many,      ///< max_ids, max_ids_of_one or max_writers are known already
  dds,           ///< DDS did not take it
  unnamed,       ///< a guarded topic that only a rule with "*" matches: see is_guarded
};
inline constexpr std::size_t refusal_count = enum_count<Refusal>;
constexpr std::string_view name(Refusal refusal) { return enum_name(refusal); }

/// Always: taken = published + all refusals.
struct DownlinkCounters {
  std::uint64_t taken = 0, published = 0, bytes = 0;
  std::uint64_t batches = 0;  ///< transactions that had some of it
  std::uint64_t missing = 0;  ///< gaps in its writers' sequences
  std::array<std::uint64_t, refusal_count> refusals{};
  Histogram age;  ///< from DDS's source time at the origin until here: between hosts as good as their clocks agree
};

struct DownlinkConfig {
  std::vector<Rule> rules;  ///< those from the ledger count
  crypto::IdentityName self;
  std::uint64_t writer = 0;  ///< see Origin
  std::string contract = "ledgerline";
};

/// From the ledger to DDS: of each block the messages that a rule wants, each writer's in order, none twice, none of
/// our own. What is not wanted is recognised by its id alone and not looked at further. Messages of others than bridges
/// (no Origin) come in the ledger's order. One thread; deterministic.
class Downlink {
 public:
  static constexpr std::size_t max_ids = 1'024;
  /// Of one first segment, so that no organisation fills the ids of all. A host has some ten topics a drone, and 16
  /// drones.
  static constexpr std::size_t max_ids_of_one = 256;
  /// Of ids that first came from somebody who may not write them: they show what is refused, and leave an organisation
  /// room for its own.
  static constexpr std::size_t max_unauthorised_ids = 64;
  static constexpr std::size_t max_writers = 16;  ///< of one id

  /// What came under one id.
  struct Topic {
    std::string name, id, type;
    const Rule* rule = nullptr;
    bool withheld = false;  ///< guarded, and only a rule with "*" matches
    DownlinkCounters counters;
  };
  /// To be published, in this order. Views hold until the next call.
  struct Delivery {
    std::size_t topic = 0;
    std::string_view type;
    std::span<const std::uint8_t> cdr;
    TimeNs source_ns = 0;  ///< real time, the origin's clock; 0: not known
  };

  /// `trusted`: whose signatures count; must outlive this.
  Downlink(DownlinkConfig config, crypto::MspRegistry& trusted);

  void on_block(TimeNs real_now, const fabric::Block& block, std::vector<Delivery>& out);
  /// Ids or prefixes ("Org2MSP/map/*") to ask `get` for after the block stream has begun: the values of latched topics.
  std::vector<std::string> latched() const;
  /// What `get` returned.
  void on_values(TimeNs real_now, const Assets& values, std::vector<Delivery>& out);
  /// DDS did not take a delivery.
  void on_failure(std::size_t topic);

  const std::deque<Topic>& topics() const { return topics_; }
  struct RefusedValue {
    std::string id;
    Refusal why = Refusal::malformed;
  };
  /// The newest since the last call that an honest bridge would not have sent; none: there was none.
  std::optional<RefusedValue> pop_refused() { return std::exchange(refused_, std::nullopt); }
  std::uint64_t malformed_frames() const { return malformed_frames_; }
  /// Not what their flags say (fabric::Transaction::problem), of an event that is not what its writer asked for, or of
  /// an id that no honest peer endorses (is_ledger_id).
  std::uint64_t unverified_transactions() const { return unverified_transactions_; }

 private:
  struct Writer {
    std::uint64_t origin = 0, signer = 0;  ///< signer: a hash, so that nobody speaks for another
    std::uint64_t life = 0, sequence = 0;
    std::string newest;  ///< CDR, where there is no sequence
  };
  struct Slot {
    std::vector<Writer> writers;
    Origin got;  ///< of the value that `get` gave
    std::string last_tx;
  };
  struct Hash {
    using is_transparent = void;
    std::size_t operator()(std::string_view text) const { return std::hash<std::string_view>{}(text); }
  };
  /// Who signed a transaction; found out once one of its messages is wanted.
  struct Signer {
    bool known = false, verified = false;
    std::uint64_t hash = 0;
    crypto::IdentityName name;
  };

  void carry(TimeNs real_now, const fabric::Transaction& tx, const SetView& set, std::vector<Delivery>& out);
  struct Match {
    const Rule* rule = nullptr;
    bool withheld = false;
  };
  Match match(std::string_view id);
  /// `strange`: its sender may not write it.
  std::size_t topic_of(std::string_view id, const Match& match, bool strange);
  /// Why DDS does not get it, no matter who wrote it; nothing: it does.
  std::optional<Refusal> unpublishable(std::size_t topic, const AssetView& asset) const;
  void identify(TimeNs real_now, const fabric::Transaction& tx, Signer& signer);
  static bool may_write(const Signer& signer, std::string_view id);
  bool accept_in_order(Slot& slot, Topic& topic, const AssetView& asset, std::uint64_t signer, bool stream);
  void deliver(TimeNs real_now, std::size_t topic, const AssetView& asset, std::vector<Delivery>& out);
  void refuse(Topic& topic, Refusal why);

  DownlinkConfig config_;
  crypto::MspRegistry& trusted_;
  std::deque<Topic> topics_;
  std::vector<Slot> slots_;  ///< as topics_
  std::unordered_map<std::string, std::size_t, Hash, std::equal_to<>> by_id_;
  std::unordered_map<std::string, std::size_t, Hash, std::equal_to<>> ids_of_;       ///< how many, by first segment
  std::unordered_map<std::string, std::size_t, Hash, std::equal_to<>> by_ros_name_;  ///< whose type it has
  std::size_t strange_ids_ = 0;
  std::optional<std::size_t> further_;  ///< the topic of all ids beyond the bounds
  std::optional<RefusedValue> refused_{};
  std::uint64_t malformed_frames_ = 0;
  std::uint64_t unverified_transactions_ = 0;
  std::string name_buffer_;
  SetView set_;
  std::vector<std::unique_ptr<SetCall>> held_;  ///< what came as JSON, while its deliveries are out
};

/// As that of an Uplink.
nlohmann::json report(const Downlink& downlink);

}  // namespace ledgerline::bridge
