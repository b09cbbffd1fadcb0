!> Impacts with restitution. `relative`: phi'+ = -eps phi'-; `absolute`: theta'+ = -eps theta'-.
module lapwing_contact_impact
  use lapwing_contact_law, only: contact_law_t
  use lapwing_kinds, only: wp
  implicit none
  private
  public :: relative_impact_t, absolute_impact_t

  type, extends(contact_law_t) :: relative_impact_t
  contains
    procedure :: reset => reset_relative, sums_chatter => always
  end type relative_impact_t

  type, extends(contact_law_t) :: absolute_impact_t
  contains
    procedure :: reset => reset_absolute, sums_chatter => on_fixed_flank
    procedure :: asks_flank_velocity => yes
  end type absolute_impact_t

contains

  pure subroutine reset_relative(self, flank_velocity, before, after, impact)
    class(relative_impact_t), intent(in) :: self
    real(wp), intent(in) :: flank_velocity       !! without effect
    real(wp), intent(in) :: before               !! approach velocity
    real(wp), intent(out) :: after               !! and after
    logical, intent(out) :: impact               !! yes
    after = -self%restitution*before
    impact = .true.
  end subroutine reset_relative

  !> With theta' = phi' + g' at a flank that moves with g'.
  pure subroutine reset_absolute(self, flank_velocity, before, after, impact)
    class(absolute_impact_t), intent(in) :: self
    real(wp), intent(in) :: flank_velocity       !! of the flank, along the approach
    real(wp), intent(in) :: before               !! approach velocity
    real(wp), intent(out) :: after               !! and after
    logical, intent(out) :: impact               !! yes
    after = -self%restitution*before - (1 + self%restitution)*flank_velocity
    impact = .true.
  end subroutine reset_absolute

  pure logical function always(self, moves)
    class(relative_impact_t), intent(in) :: self
    logical, intent(in) :: moves                 !! without effect
    always = .true.
  end function always

  !> Rebounds from a moving flank tend to a finite speed.
  pure logical function on_fixed_flank(self, moves)
    class(absolute_impact_t), intent(in) :: self
    logical, intent(in) :: moves                 !! whether the flank does
    on_fixed_flank = .not. moves
  end function on_fixed_flank

  pure logical function yes(self)
    class(absolute_impact_t), intent(in) :: self
    yes = .true.
  end function yes
end module lapwing_contact_impact
