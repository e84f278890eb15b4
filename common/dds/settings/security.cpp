#include "common/dds/settings/security.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "common/base/printable.hpp"

namespace ledgerline::dds {
namespace {

// DDS Security 1.1, 9.4.1.2. Names and payloads are encrypted; the messages around them are signed.
constexpr const char* governance = R"(<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains><id_range><min>0</min><max>230</max></id_range></domains>
      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
      <enable_join_access_control>true</enable_join_access_control>
      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
      <rtps_protection_kind>SIGN</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>ENCRYPT</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
)";

constexpr const char* grant = R"(
    <grant name="member{}">
      <subject_name>{}</subject_name>
      <validity><not_before>{}</not_before><not_after>{}</not_after></validity>
      <allow_rule>
        <domains><id_range><min>0</min><max>230</max></id_range></domains>
        <publish><topics><topic>*</topic></topics></publish>
        <subscribe><topics><topic>*</topic></topics></subscribe>
      </allow_rule>
      <default>DENY</default>
    </grant>)";

std::string permissions(const std::string& grants) {
  return R"(<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
     xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>)" +
         grants + "\n  </permissions>\n</dds>\n";
}

std::string date(std::int64_t unix_s) { return fmt::format("{:%Y-%m-%dT%H:%M:%S}", fmt::gmtime(unix_s)); }

}  // namespace

Result<SecurityDocuments> make_security_documents(const crypto::KeyAndCertificate& authority,
                                                  const std::vector<std::string>& members) {
  auto signer_pem = crypto::make_document_authority(authority);
  if (!signer_pem) return signer_pem.error();
  const crypto::KeyAndCertificate signer{authority.key_pem, *signer_pem};
  const auto own = crypto::parse_certificate(*signer_pem);
  if (!own) return own.error();

  std::string grants;
  for (std::size_t i = 0; i < members.size(); ++i) {
    const auto member = crypto::parse_certificate(members[i]);
    if (!member) return member.error();
    grants += fmt::format(grant, i + 1, xml_text(member->subject), date(own->not_before_s), date(own->not_after_s));
  }
  auto signed_governance = crypto::sign_document(signer, governance);
  if (!signed_governance) return signed_governance.error();
  auto signed_permissions = crypto::sign_document(signer, permissions(grants));
  if (!signed_permissions) return signed_permissions.error();
  return SecurityDocuments{*signer_pem, std::move(*signed_governance), std::move(*signed_permissions)};
}

}  // namespace ledgerline::dds
