#pragma once
#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "common/msg/ros.hpp"

namespace ledgerline::ground {

/// What ROS 2 hears of a drone beside its failsafe's transitions, which say nothing of one on the ground: a stop,
/// what speaks against a take-off, and for ten seconds what was refused last. One thread.
class Diagnosis {
 public:
  struct Finding {
    DiagnosticLevel level = DiagnosticLevel::ok;
    std::string words;
    bool operator==(const Finding&) const = default;
  };

  void refuse(TimeNs now, const std::string& why) {
    refused_ = why;
    refused_ns_ = now;
  }
  /// Five times a second.
  bool is_due(TimeNs now) const { return !shown_ || now - looked_ns_ >= look_gap_ns; }
  /// What is to be published, if it is new; the same refusal is, each second at most.
  std::optional<Finding> update(TimeNs now, Finding finding) {
    looked_ns_ = now;
    if (now - refused_ns_ > keep_ns) refused_.clear();
    const bool refused_again = !refused_.empty() && refused_ns_ > shown_ns_ && now - shown_ns_ >= again_ns;
    if (!refused_.empty()) {
      finding.level = std::max(finding.level, DiagnosticLevel::warn);
      finding.words += "; " + refused_;
    }
    if (shown_ == finding && !refused_again) return std::nullopt;
    shown_ = finding;
    shown_ns_ = now;
    return finding;
  }

 private:
  static constexpr TimeNs look_gap_ns = 200 * ns_per_ms, again_ns = ns_per_s, keep_ns = 10 * ns_per_s;
  std::string refused_;
  std::optional<Finding> shown_;
  TimeNs refused_ns_ = 0, shown_ns_ = 0, looked_ns_ = 0;
};

}  // namespace ledgerline::ground
