MODULE {{ program }}
{% for line in heading %}
! {{ line }}
{% endfor %}
! Joint values in degrees.
{% for point in points %}
{% if point.left_out %}
! {{ point.name }} is left out: {{ point.left_out }}
{% else %}
  CONST jointtarget {{ point.name }}:=[[{{ point.deg | digits(7, ",") }}],[9E9,9E9,9E9,9E9,9E9,9E9]];{% if point.label != point.name %}  ! {{ point.label }}{% endif %}

{% endif %}
{% endfor %}
ENDMODULE
