#include "common/crypto/identities/renewal.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::crypto {

std::int64_t days_left(std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left_s = not_after_s - now_s;
  return left_s >= 0 ? left_s / day_s : -((-left_s + day_s - 1) / day_s);
}

Ends ends(std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left = days_left(not_after_s, now_s);
  if (left < 0) return Ends::over;
  if (left < urgent_within_days) return Ends::urgent;
  return left < renew_within_days ? Ends::soon : Ends::later;
}

std::string span_in_words(std::int64_t seconds) {
  constexpr std::int64_t minute_s = 60, hour_s = 3'600;
  if (seconds >= 2 * day_s) return fmt::format("{} days", seconds / day_s);
  if (seconds >= 2 * hour_s) return fmt::format("{} hours", seconds / hour_s);
  if (seconds >= 2 * minute_s) return fmt::format("{} minutes", seconds / minute_s);
  return fmt::format("{} seconds", seconds);
}

std::string end_in_words(const std::string& whose, std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left_s = not_after_s - now_s;
  if (left_s < 0) return fmt::format("the certificate of {} has ended", printable(whose));
  return fmt::format("the certificate of {} ends in {}", printable(whose), span_in_words(left_s));
}

std::optional<Result<Renewal::Pair>> Renewal::check_files(const std::vector<std::string>& files, std::int64_t now_s,
                                                          const Load& load) {
  const bool is_due = pop_recheck(now_s);
  if (!pop_changed(files) && !is_due) return std::nullopt;
  auto found = load();
  const std::string before = in_use_pem_;
  if (Status fits = check(found, now_s); !fits) return fits.error();
  found->is_new = found->certificate_pem != before;
  return found;
}

bool Renewal::pop_changed(const std::vector<std::string>& files) {
  auto now = stamps(files);
  const bool still = now == seen_;
  seen_ = std::move(now);
  if (!still || seen_ == taken_) return false;
  taken_ = seen_;
  return true;
}

std::vector<Renewal::Stamp> Renewal::stamps(const std::vector<std::string>& files) {
  std::vector<Stamp> all;
  for (const std::string& file : files) {
    struct stat info {};
    Stamp one{.file = file};
    if (!file.empty() && ::stat(file.c_str(), &info) == 0) {
      one.device = info.st_dev;
      one.inode = info.st_ino;
      one.size = static_cast<std::uint64_t>(info.st_size);
      one.changed_ns = info.st_ctim.tv_sec * std::int64_t{1'000'000'000} + info.st_ctim.tv_nsec;
    }
    all.push_back(std::move(one));
  }
  return all;
}

Status Renewal::check(const Result<Pair>& found, std::int64_t now_s) {
  valid_from_s_.reset();
  if (!found) return found.error();
  const Certificate& next = found->certificate;
  if (!found->key_pem.empty()) {
    if (Status fits = check_fits(found->key_pem, found->certificate_pem); !fits) return fits;
  }
  if (!subject_.empty() && next.subject != subject_)
    return Error{
        fmt::format("it is of another subject, {}: grants and leases are of {}, and a program changes its "
                    "subject at a start alone",
                    printable(next.subject), printable(subject_))};
  // The one in use goes on to its end and behind it: what changed are the files beside it.
  const bool in_use = is_checked_ && found->certificate_pem == in_use_pem_;
  if (!in_use && now_s < next.not_before_s) {
    valid_from_s_ = next.not_before_s;
    return Error{fmt::format("it is not valid yet, for another {} s: it is taken then, or do the clocks differ?",
                             next.not_before_s - now_s)};
  }
  if (!in_use && now_s > next.not_after_s) return Error{"it has ended already"};
  not_after_s_ = next.not_after_s;
  in_use_pem_ = found->certificate_pem;
  is_checked_ = true;
  reported_days_.reset();
  return done;
}

bool Renewal::pop_recheck(std::int64_t now_s) {
  if (!valid_from_s_ || now_s < *valid_from_s_) return false;
  valid_from_s_.reset();
  return true;
}

std::optional<Renewal::Notice> Renewal::pop_end_notice(std::int64_t now_s) {
  const Ends end = ends(not_after_s_, now_s);
  if (end == Ends::later) return std::nullopt;
  const std::int64_t left = days_left(now_s);
  if (reported_days_ == left) return std::nullopt;
  reported_days_ = left;
  return Notice{end == Ends::soon ? Weight::warning : Weight::alarm, end_in_words(whose_, not_after_s_, now_s)};
}

Result<Renewal::Pair> read_pair(const IdentityFiles& files) {
  auto certificate_pem = ledgerline::read_file(files.certificate);
  if (!certificate_pem) return certificate_pem.error();
  auto certificate = parse_certificate(*certificate_pem);
  if (!certificate) return Error{fmt::format("{}: {}", files.certificate, certificate.error().message)};
  auto key_pem = read_key_file(files.private_key);
  if (!key_pem) return key_pem.error();
  return Renewal::Pair{std::move(*certificate), std::move(*key_pem), std::move(*certificate_pem)};
}

}  // namespace ledgerline::crypto
