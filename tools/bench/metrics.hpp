#pragma once
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

/// What the runs of a side-by-side measurement say together. No I/O.
namespace ledgerline::bench {

/// Who may be measured, in the order of the table.
enum class Design { gateway, direct, polling, ledgerline };
struct Competitor {
  std::string id;     ///< "published"
  std::string title;  ///< for the table
  Design design = Design::gateway;
  bool published_settings = false;  ///< three orderers, 2 s / 10; otherwise one, a block for each transaction
  std::string signer = {};          ///< of Ledgerline alone: "libcrypto" or "mbedtls"
  bool only_when_asked = false;
  std::string blocks = "peer";  ///< of Ledgerline: ledger.blocks
  bool validated = false;       ///< of Ledgerline: blocks and transactions are validated, by a trust anchor
  /// Of Ledgerline: each side's organisation has an endorser of its own, as a program beside its client or in it.
  enum class Endorser { none, beside, within } endorser = Endorser::none;
};
const std::vector<Competitor>& competitors();
const Competitor* find_competitor(const std::string& id);

/// One competitor at one rate, once.
struct Turn {
  std::string competitor;
  int rate = 0;         ///< msg/s, both directions
  int alternation = 0;  ///< from 0
  int position = 0;     ///< in its alternation, from 0
  std::uint64_t sent = 0, answered = 0, replaced = 0;
  std::vector<double> times_ms = {};  ///< of every message sent, as Account has them; in any order
  double cpu_s = 0;                   ///< of both clients, in the measured time
  double ledger_cpu_s = 0;            ///< of the network, and of endorsers, likewise
  std::uint64_t answers = 0;          ///< in the measured time
  std::uint64_t transactions = 0, failed = 0, dropped = 0;  ///< of both clients, warm-up too
  std::uint64_t blocks = 0;                                 ///< that Ledgerline's two clients took, likewise
  std::uint64_t blocks_as_ordered = 0;                      ///< of these, before their peer delivered them
  double confirmed_after_ms = 0;                            ///< of side a, median: how long before
  bool timed_out = false;                                   ///< it was ended by its time limit
  std::string why = {};                                     ///< what a client complained of last

  std::uint64_t lost() const { return sent - answered - replaced; }
  /// Nearest rank. 0 when there is none.
  double quantile_ms(double q) const;
  /// A message has two ends: an exchange is two messages. Nothing without an answer.
  std::optional<double> cpu_ms_per_message() const;
  std::optional<double> ledger_cpu_ms_per_message() const;
  /// More than 1 % without an answer of their own, or p99 above 1 s.
  bool saturated() const;
  /// It had to be ended, or the drain was over, with more than 1 % lost.
  bool collapsed() const;
};

struct Spread {
  double median = 0, low = 0, high = 0;
  int count = 0;
};
/// Nothing of nothing.
std::optional<Spread> spread_of(std::vector<double> values);

struct Metrics {
  std::optional<Spread> p50_ms, p99_ms, cpu_ms_per_message, ledger_cpu_ms_per_message;
  std::uint64_t sent = 0, answered = 0, replaced = 0, lost = 0;
  int runs = 0, saturated = 0, collapsed = 0;
};
/// A way of Ledgerline divided by a baseline, within each alternation: below 1, it is better. Baselines are the stock
/// clients, and Ledgerline's usual way for its others.
struct Ratios {
  std::string ours, against;
  int rate = 0;
  std::optional<Spread> p50, p99, cpu, ledger_cpu;
};

struct Summary {
  std::map<int, std::map<std::string, Metrics>> metrics;  ///< by rate, by competitor
  std::vector<Ratios> ratios;                             ///< by rate, ours and baseline, as the table
  /// The lowest rate at which at least half of the runs saturate; nothing: none did.
  std::map<std::string, std::optional<int>> saturates_at;
};
Summary summarize(const std::vector<Turn>& runs);

std::string to_table(const Summary& summary);
/// Whole: with every time.
nlohmann::json to_json(const Turn& run);
nlohmann::json to_json(const Summary& summary);

}  // namespace ledgerline::bench
