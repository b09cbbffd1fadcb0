!> Contact laws as a caller names them.
module lapwing_contact_choice
  use lapwing_codes, only: law_compliant, law_rigid, law_absolute
  use lapwing_contact_compliant, only: compliant_t
  use lapwing_contact_impact, only: relative_impact_t, absolute_impact_t
  use lapwing_contact_law, only: contact_law_t
  use lapwing_contact_rigid, only: rigid_t
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: choose_law

contains

  !> Law of the given names; `absolute` goes with restitution alone.
  subroutine choose_law(contact_law, impact_law, restitution, law)
    integer, intent(in) :: contact_law                       !! law_restitution, ...
    integer, intent(in) :: impact_law                        !! law_relative or law_absolute
    real(wp), intent(in) :: restitution                      !! epsilon
    class(contact_law_t), allocatable, intent(out) :: law    !! the law
    if (contact_law == law_compliant) then
      allocate (compliant_t :: law)
    else if (contact_law == law_rigid) then
      allocate (rigid_t :: law)
    else if (impact_law == law_absolute) then
      allocate (absolute_impact_t :: law)
    else
      allocate (relative_impact_t :: law)
    end if
    law%restitution = restitution
  end subroutine choose_law
end module lapwing_contact_choice
