#include "tools/checks/core/identity.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "common/crypto/crypto.hpp"
#include "common/crypto/identities/renewal.hpp"

namespace ledgerline::checks {
namespace {

/// Why its organisation does not know it, whenever it is asked; empty: it does.
std::string outsider(const IdentityInputs& inputs, const std::vector<AuthorityInputs>& authorities,
                     std::int64_t now_s) {
  std::vector<crypto::MspRoot> roots;
  for (const AuthorityInputs& one : authorities) roots.push_back({one.msp_id, one.pem});
  const auto registry = crypto::make_msp_registry(crypto::Library::libcrypto, std::move(roots));
  const auto member = registry->member(crypto::serialized_identity(inputs.msp_id, inputs.certificate_pem), now_s);
  return member ? "" : member.error().message;
}

/// Each without its line breaks.
std::set<std::string> certificates_of(const std::string& pem) {
  std::set<std::string> all;
  for (std::string one : crypto::certificates_in(pem)) {
    one.erase(std::remove_if(one.begin(), one.end(), [](char c) { return c == '\n' || c == '\r' || c == ' '; }),
              one.end());
    all.insert(std::move(one));
  }
  return all;
}

// Roots and intermediates, in whatever order a file has them; one of the two may leave some out.
bool same_authority(const std::string& a, const std::string& b) {
  const auto of_a = certificates_of(a), of_b = certificates_of(b);
  if (of_a.empty() || of_b.empty()) return false;
  return std::includes(of_a.begin(), of_a.end(), of_b.begin(), of_b.end()) ||
         std::includes(of_b.begin(), of_b.end(), of_a.begin(), of_a.end());
}

/// Which other organisation has issued it; empty: none of them.
std::string issuer_of(const IdentityInputs& inputs, const std::vector<AuthorityInputs>& authorities,
                      std::int64_t now_s) {
  for (const AuthorityInputs& one : authorities) {
    IdentityInputs as = inputs;
    as.msp_id = one.msp_id;
    if (one.msp_id != inputs.msp_id && outsider(as, authorities, now_s).empty()) return one.msp_id;
  }
  return "";
}

std::string cure_of_order(const IdentityInputs& inputs) {
  if (inputs.msp_dir.empty())
    return fmt::format("move the certificate of the key {} to the front of {}", inputs.key_file,
                       inputs.certificate_file);
  return fmt::format("`ledgerline init --certificate {} --msp-dir {}`", inputs.certificate_file, inputs.msp_dir);
}

bool is_locked(const std::string& key_pem) { return key_pem.find("ENCRYPTED") != std::string::npos; }

/// Leaves the key's own certificate first, so that dates and issuer are checked of that one.
void assess_pair(IdentityInputs& inputs, const std::string& who, Findings& out) {
  constexpr const char* check = "identity";
  if (inputs.key_pem.empty()) return;
  if (is_locked(inputs.key_pem)) {
    out.push_back(
        flag(Problem::key_locked, check, inputs.key_file, cure_of(Problem::key_locked, "KEY", inputs.key_file)));
    return;
  }
  auto in_order = crypto::own_first(inputs.key_pem, inputs.certificate_pem);
  if (!in_order) {
    out.push_back(flag(Problem::key_misfit, check, who + ": " + in_order.error().message));
  } else if (*in_order != inputs.certificate_pem) {
    out.push_back(flag(Problem::certificate_order, check, inputs.certificate_file, cure_of_order(inputs)));
    inputs.certificate_pem = std::move(*in_order);
  }
}

}  // namespace

// A sequence of more than 255 bytes, which is what each certificate is.
bool is_der(const std::string& bytes) { return bytes.starts_with("\x30\x82"); }

std::string cure_of_der(const std::string& file) {
  return fmt::format("`openssl x509 -inform der -in {0} -out {0}.pem && cp {0}.pem {0} && rm {0}.pem`", file);
}

Findings assess(IdentityInputs inputs, const std::vector<AuthorityInputs>& authorities, std::int64_t now_s) {
  constexpr const char* check = "identity";
  const std::string who = fmt::format("{} in {}", inputs.msp_id, inputs.place);
  Findings out;
  if (!inputs.forbidden.empty())
    return {flag(
        Problem::file_forbidden, check, fmt::format("{} by {}", inputs.forbidden, inputs.user),
        fmt::format("as root: `chown -R {}: {}`; or run doctor as the programs' user", inputs.user, inputs.forbidden))};
  if (!inputs.no_key.empty()) out.push_back(flag(Problem::key_missing, check, inputs.no_key));
  if (inputs.key_is_open)
    out.push_back(flag(Problem::key_open, check, inputs.key_file, fmt::format("`chmod 600 {}`", inputs.key_file)));
  if (!inputs.no_certificate.empty()) {
    out.push_back(flag(Problem::certificate_missing, check, inputs.no_certificate));
    return out;
  }
  if (is_der(inputs.certificate_pem)) {
    out.push_back(flag(Problem::not_pem, check, inputs.certificate_file, cure_of_der(inputs.certificate_file)));
    return out;
  }
  if (const auto parsed = crypto::parse_certificate(inputs.certificate_pem); !parsed) {
    out.push_back(flag(Problem::certificate_wrong, check, who + ": " + parsed.error().message));
    return out;
  }
  assess_pair(inputs, who, out);
  const auto certificate = crypto::parse_certificate(inputs.certificate_pem);
  if (!certificate) {
    out.push_back(flag(Problem::certificate_wrong, check, who + ": " + certificate.error().message));
    return out;
  }
  const std::int64_t left_s = certificate->not_after_s - now_s;
  const bool in_date = certificate->not_before_s <= now_s && now_s <= certificate->not_after_s;
  if (left_s < 0) {
    out.push_back(
        flag(Problem::identity_expired, check, fmt::format("{}, {} ago", who, crypto::span_in_words(-left_s))));
  } else if (now_s < certificate->not_before_s) {
    out.push_back(flag(Problem::identity_not_yet, check, who));
  } else if (crypto::days_left(certificate->not_after_s, now_s) < crypto::renew_within_days) {
    out.push_back(flag(Problem::identity_ends, check, fmt::format("{}, in {}", who, crypto::span_in_words(left_s))));
  }
  if (!authorities.empty() && in_date) {
    if (const std::string why = outsider(inputs, authorities, now_s); !why.empty()) {
      const std::string issuer = issuer_of(inputs, authorities, now_s);
      out.push_back(
          flag(Problem::identity_foreign, check,
               fmt::format("{}{}: {}", who, inputs.channel.empty() ? "" : " on channel " + inputs.channel, why),
               issuer.empty() ? fmt::format("let the authority of {}, as the channel has it, sign the request, then "
                                            "`ledgerline init --certificate FILE`; a revoked one needs a new key",
                                            inputs.msp_id)
                              : fmt::format("it is of {}: set msp_id to that, or put an identity of {} in {}", issuer,
                                            inputs.msp_id, inputs.place)));
    }
  }
  if (out.empty())
    out.push_back(
        fine(check, fmt::format("{} {}, for {}", inputs.msp_id, certificate->subject, crypto::span_in_words(left_s))));
  return out;
}

Findings assess_tls_pair(const IdentityInputs& inputs, const std::string& whose, std::int64_t now_s) {
  Findings out;
  for (Finding& one : assess(inputs, {}, now_s)) {
    one.check = "tls";
    if (!one.problem) {
      out.push_back(fine("tls", fmt::format("{} of {}", inputs.certificate_file, whose)));
    } else if (one.problem == Problem::identity_ends) {
      one.cure = "let the TLS authority sign a new one, and put it into this one's place: programs that run take it";
      out.push_back(std::move(one));
    } else if (one.problem == Problem::certificate_missing || one.problem == Problem::certificate_wrong ||
               one.problem == Problem::key_missing || one.problem == Problem::key_misfit ||
               one.problem == Problem::identity_expired || one.problem == Problem::identity_not_yet) {
      out.push_back(flag(Problem::tls_pair_wrong, "tls",
                         fmt::format("{} and {} of {}: {}: {}", inputs.certificate_file, inputs.key_file, whose,
                                     describe(*one.problem).name, one.what)));
    } else {
      out.push_back(std::move(one));  // a file's own, with a cure that names it
    }
  }
  return out;
}

Findings assess(const TrustInputs& inputs) {
  constexpr const char* check = "trust";
  Findings out;
  for (const TrustInputs::Msp& msp : inputs.msps) {
    if (!msp.why.empty()) {
      out.push_back(flag(msp.problem.value_or(Problem::authority_unreadable), check,
                         fmt::format("{} of {}: {}", msp.id, inputs.program, msp.why), msp.cure));
      continue;
    }
    const auto known = std::find_if(inputs.channel.begin(), inputs.channel.end(),
                                    [&](const AuthorityInputs& one) { return one.msp_id == msp.id; });
    if (inputs.channel.empty() || (known != inputs.channel.end() && same_authority(known->pem, msp.pem))) continue;
    out.push_back(flag(Problem::authority_foreign, check,
                       fmt::format("{} of {}, {}{}", msp.id, inputs.program, msp.file,
                                   known == inputs.channel.end() ? ": the channel has no such organisation" : "")));
  }
  for (const AuthorityInputs& one : inputs.channel) {
    if (std::none_of(inputs.msps.begin(), inputs.msps.end(), [&](const auto& msp) { return msp.id == one.msp_id; }))
      out.push_back(flag(Problem::organisation_missing, check, fmt::format("{} of {}", one.msp_id, inputs.program)));
  }
  if (out.empty())
    out.push_back(fine(check, fmt::format("{} trusts {} organisations", inputs.program, inputs.msps.size())));
  return out;
}

}  // namespace ledgerline::checks
