#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

namespace ledgerline::crypto {

// How near a certificate is to its end, in one measure for doctor, status lines and alarms.

inline constexpr std::int64_t day_s = 86'400;
/// A month: an authority of another house, or one that is asked by mail, needs weeks.
inline constexpr std::int64_t renew_within_days = 30;
/// No flight should begin on a certificate that may end before somebody looks again after a weekend.
inline constexpr std::int64_t urgent_within_days = 3;

enum class Ends { later, soon, urgent, over };

/// Whole days until `not_after_s`; below 0: it has ended. Both are Unix time.
std::int64_t days_left(std::int64_t not_after_s, std::int64_t now_s);
Ends ends(std::int64_t not_after_s, std::int64_t now_s);
/// "3 days", "20 hours", "5 minutes": the largest unit of which there are two.
std::string span_in_words(std::int64_t seconds);
/// "the certificate of X ends in 12 days"; `whose` is made printable.
std::string end_in_words(const std::string& whose, std::int64_t not_after_s, std::int64_t now_s);

/// The files of a certificate in use, watched: whether what lies there now is taken in place of it, and when its end is
/// to be reported. The ledger knows grants, leases and commands by MSP and subject, so a renewed certificate goes on
/// with them; one of another subject is another person, and is refused. One thread.
///
///                 a pair that fits, of the same subject, in date, of the MSP's authority
///     in use ─────────────────────────────────────────────────────────────────────────▶ the new one is in use
///        └─── anything else: refused with words, once; the old one stays in use
///
/// One that is refused since it is not valid yet is looked at once more when it becomes so.
class Renewal {
 public:
  /// `whose`: for words; `subject`: that it must have, empty: any (of TLS alone, where nobody goes by it);
  /// `not_after_s`: the end of the one in use, `in_use_pem`: itself, where it is known.
  Renewal(std::string whose, std::string subject, std::int64_t not_after_s, std::string in_use_pem = {})
      : whose_(std::move(whose)),
        subject_(std::move(subject)),
        not_after_s_(not_after_s),
        in_use_pem_(std::move(in_use_pem)) {}

  /// A pair as it was read from the files.
  struct Pair {
    Certificate certificate;
    std::string key_pem, certificate_pem;  ///< empty key: its reader has already verified that the two fit
    bool is_new = true;                    ///< by check_files(): not the one that was in use
  };
  using Load = std::function<Result<Pair>()>;
  /// One check of many, by one stat of each file: nullopt where they are as before. A change counts when the files are
  /// the same from one look to the next, since certificate and key are two; the first look counts, too, unless
  /// ignore_present(). Then `load` reads them. A pair: to be used from now on. An error: why not, once for each change.
  std::optional<Result<Pair>> check_files(const std::vector<std::string>& files, std::int64_t now_s, const Load& load);
  /// In use now, whatever its dates are.
  void begin(const Pair& in_use) {
    not_after_s_ = in_use.certificate.not_after_s;
    in_use_pem_ = in_use.certificate_pem;
    is_checked_ = true;
  }
  /// What lies in these files now is about to be read, and is no news.
  void ignore_present(const std::vector<std::string>& files) { taken_ = seen_ = stamps(files); }

  /// done: to be taken, and what is reported from here on is of the new one. An error: why not.
  Status check(const Result<Pair>& found, std::int64_t now_s);

  enum class Weight { warning, alarm };
  struct Notice {
    Weight weight{};
    std::string words;
  };
  /// What is to be reported of the end now: once a day from a month before, as an alarm from three days before.
  std::optional<Notice> pop_end_notice(std::int64_t now_s);

  /// True, once: what was refused as not valid yet is valid now, and is to be checked again though no file has changed.
  bool pop_recheck(std::int64_t now_s);

  std::int64_t not_after_s() const { return not_after_s_; }
  std::int64_t days_left(std::int64_t now_s) const { return crypto::days_left(not_after_s_, now_s); }
  const std::string& whose() const { return whose_; }

 private:
  struct Stamp {
    std::string file;
    std::uint64_t device = 0, inode = 0, size = 0;  ///< all 0: it is not there
    std::int64_t changed_ns = 0;
    bool operator==(const Stamp&) const = default;
  };
  static std::vector<Stamp> stamps(const std::vector<std::string>& files);
  /// True, once: the files have changed, and not since the last look.
  bool pop_changed(const std::vector<std::string>& files);

  std::string whose_, subject_;
  std::int64_t not_after_s_;
  std::string in_use_pem_;   ///< empty: not known
  bool is_checked_ = false;  ///< it was found good once; what was only said to be in use is checked as any other
  std::optional<std::int64_t> reported_days_;
  std::optional<std::int64_t> valid_from_s_;  ///< of what was refused for that alone
  std::vector<Stamp> taken_, seen_;
};

/// What lies in the files, the key as read_key_file() takes it. Whether the two fit is for Renewal::check().
Result<Renewal::Pair> read_pair(const IdentityFiles& files);

}  // namespace ledgerline::crypto
